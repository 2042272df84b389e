#pragma once

#include <time.h>

#include <cmath>
#include <cstdint>

namespace palpate {

/// Time of CLOCK_MONOTONIC, in nanoseconds: never set back, comparable between threads and processes of one
/// machine only. Read in user space through the vDSO, without a system call.
inline std::int64_t monotonic_ns() noexcept {
  timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return static_cast<std::int64_t>(now.tv_sec) * 1'000'000'000 + now.tv_nsec;
}

/// Duration in nanoseconds, rounded.
inline std::int64_t to_ns(double seconds) noexcept {
  return std::llround(seconds * 1e9);
}

}  // namespace palpate
