#include "palpate/base/clock.h"

#include <gtest/gtest.h>

#include <chrono>

namespace palpate {
namespace {

std::int64_t steady_ns() {
  using std::chrono::steady_clock, std::chrono::nanoseconds, std::chrono::duration_cast;
  return duration_cast<nanoseconds>(steady_clock::now().time_since_epoch()).count();
}

TEST(Clock, IsTheSteadyClockInNanoseconds) {
  for (int n = 0; n < 1000; ++n) {
    const std::int64_t before = steady_ns(), now = monotonic_ns(), after = steady_ns();
    ASSERT_LE(before, now);
    ASSERT_LE(now, after);
  }
}

}  // namespace
}  // namespace palpate
