#include "verification/stability_turning.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <cstdlib>

namespace palpate {
namespace {

// number of rotations: a tenth of PALPATE_TEST_PRESSES
int turns_in_all() {
  const char* value = std::getenv("PALPATE_TEST_PRESSES");
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  constexpr int kDefault = 300;
#else
  constexpr int kDefault = 10'000;
#endif
  return std::max(1, (value != nullptr ? std::atoi(value) : kDefault) / 10);
}

TEST(StabilityTurning, NoLeverPassesAPlate) {
  SCOPED_TRACE("seed " + std::to_string(kTurningSeed));
  const auto figures = turning_figures(turns_in_all(), {});
  ASSERT_TRUE(figures.ok());
  ASSERT_EQ(figures->size(), 4u);
  for (const Figure& figure : *figures) {
    std::printf("%-28s %.4f %s of %d\n", figure.name.c_str(), figure.value, figure.unit.c_str(),
                static_cast<int>(figure.n));
    EXPECT_TRUE(figure.ok()) << figure.name << ": " << figure.value << " " << figure.unit;
  }
  EXPECT_GT((*figures)[0].value, 0) << "they touch";
  EXPECT_GT((*figures)[1].value, 0) << "shafts do, too";
}

TEST(StabilityTurning, CanBeInterrupted) {
  const std::atomic<bool> stop = true;
  const auto figures = turning_figures(1, Progress({}, &stop));
  ASSERT_FALSE(figures.ok());
  EXPECT_EQ(figures.error().kind, ErrorKind::kInterrupted);
}

}  // namespace
}  // namespace palpate
