#include "verification/stability_contact.h"

#include <gtest/gtest.h>

#include <atomic>

namespace palpate {
namespace {

constexpr ContactEffort kLittle{2, 1, 0.5, 70, 1.2, 20};

TEST(StabilityContact, FiguresAreWithinLimits) {
  SCOPED_TRACE("seed " + std::to_string(kContactSeed));
  const auto figures = contact_figures({}, kLittle);
  ASSERT_TRUE(figures.ok());
  int worst = 0, farthest = 0, loose = 0, deepest = 0, missed = 0, turning = 0;
  for (const Figure& figure : *figures) {
    SCOPED_TRACE(figure.name);
    worst += figure.name.ends_with("/worst") && figure.unit == "percent" && figure.limit == 2;
    farthest += figure.name.ends_with("/farthest") && figure.unit == "um" && figure.limit == 1;
    loose += figure.name.ends_with("/loose") && figure.unit == "ticks" && figure.limit == 0;
    if (figure.name.starts_with("stability/turning/")) {
      ++turning;
      EXPECT_TRUE(figure.ok()) << figure.value << " " << figure.unit;
      continue;
    }
    deepest += figure.name.ends_with("/deepest") && figure.unit == "mm" && figure.limit == 0.05;
    const bool is_missed = figure.name.ends_with("/missed");
    missed += is_missed && figure.unit == "percent" && figure.limit == 10;
    // with only ten presses, more may miss by chance
    EXPECT_TRUE(is_missed ? figure.value <= 50 : figure.ok()) << figure.value << " " << figure.unit;
    EXPECT_GT(figure.n, 0u);
  }
  EXPECT_EQ(worst, 2) << "of static and of dynamic friction";
  EXPECT_EQ(farthest, 2) << "trembling and turning";
  EXPECT_EQ(loose, 2);
  EXPECT_GT(deepest, 3) << "cartilages, menisci and the patella";
  EXPECT_EQ(missed, deepest);
  EXPECT_EQ(turning, 4) << "deepest, of shafts too, through, not felt";
  EXPECT_EQ(figures->size(), static_cast<std::size_t>(worst + farthest + loose + deepest + missed + turning));
}

TEST(StabilityContact, Repeats) {
  const auto once = contact_figures({}, kLittle), again = contact_figures({}, kLittle);
  ASSERT_TRUE(once.ok());
  ASSERT_TRUE(again.ok());
  ASSERT_EQ(once->size(), again->size());
  for (std::size_t n = 0; n < once->size(); ++n) {
    EXPECT_EQ((*once)[n].name, (*again)[n].name);
    EXPECT_EQ((*once)[n].value, (*again)[n].value) << (*once)[n].name;
  }
}

TEST(StabilityContact, CanBeInterrupted) {
  const std::atomic<bool> stop = true;
  const auto figures = contact_figures(Progress({}, &stop), kLittle);
  ASSERT_FALSE(figures.ok());
  EXPECT_EQ(figures.error().kind, ErrorKind::kInterrupted);
}

}  // namespace
}  // namespace palpate
