#pragma once

#include <string>
#include <vector>

namespace palpate {

/// SIMD targets that are compiled in and supported by this machine, best first, by Highway's names.
std::vector<std::string> simd_targets();

}  // namespace palpate
