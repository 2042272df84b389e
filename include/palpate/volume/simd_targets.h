#pragma once

#include <string>
#include <vector>

namespace palpate {

/// SIMD targets compiled in and usable on this machine, best first, by Highway's names.
std::vector<std::string> simd_targets();

}  // namespace palpate
