#pragma once

#include <cstddef>

namespace palpate {

/// What two threads write is kept this far apart, so that neither takes the other's line away. A constant of
/// ours: std::hardware_destructive_interference_size may differ between two files that are linked together.
inline constexpr std::size_t kCacheLine_bytes = 64;

}  // namespace palpate
