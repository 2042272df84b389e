#pragma once

#include <cstddef>

namespace palpate {

/// Separation of data written by two threads, so that they do not share a cache line (false sharing); bytes.
/// A constant of palpate's own, because std::hardware_destructive_interference_size may differ between two
/// object files that are linked together.
inline constexpr std::size_t kCacheLine_bytes = 64;

}  // namespace palpate
