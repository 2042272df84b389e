#include "verification/removal.h"

#include <gtest/gtest.h>

#include <atomic>

#include "verification/removal_plants.h"
#include "verification/removal_thin.h"
#include "verification/removal_volumes.h"

namespace palpate {
namespace {

TEST(RemovalFigures, KeepTheirLimits) {
  const auto figures = removal_figures({});
  ASSERT_TRUE(figures.ok());
  EXPECT_EQ(figures->size(), 10);
  for (const Figure& figure : *figures) {
    ASSERT_TRUE(figure.limit.has_value()) << figure.name;
    EXPECT_TRUE(figure.ok()) << figure.name << ": " << figure.value << " " << figure.unit << ", limit "
                             << *figure.limit;
  }
}

// a part of `palpate verify removal`
TEST(PathVolumes, AreThoseOfGeometry) {
  const auto figures = path_volume_figures({.all = false}, {});
  ASSERT_TRUE(figures.ok());
  EXPECT_EQ(figures->size(), 6);
  for (const Figure& figure : *figures)
    EXPECT_TRUE(figure.ok()) << figure.name << ": " << figure.value << " " << figure.unit << ", limit "
                             << *figure.limit;
}

// a part of `palpate verify removal`
TEST(CuttingPlants, GiveNothingOutAndDoNotSwing) {
  const auto figures = cutting_plants_figures({.explored_s = 2.5, .pressed_s = 2, .settled_s = 2.5}, {});
  ASSERT_TRUE(figures.ok());
  EXPECT_EQ(figures->size(), 50);
  int limits = 0;
  for (const Figure& figure : *figures) {
    if (figure.name.ends_with("/put-in")) {
      EXPECT_GT(figure.value, 0) << figure.name << ": nothing was cut";
    }
    if (!figure.limit) continue;
    ++limits;
    EXPECT_TRUE(figure.ok()) << figure.name << ": " << figure.value << " " << figure.unit << ", limit "
                             << *figure.limit;
  }
  EXPECT_EQ(limits, 20);
}

// a part of `palpate verify removal`
TEST(ThinBone, CostsWhatIsLost) {
  const auto figures = thin_bone_figures({.all = false, .cut_s = 0.2}, {});
  ASSERT_TRUE(figures.ok());
  EXPECT_EQ(figures->size(), 2);
  for (const Figure& figure : *figures)
    EXPECT_TRUE(figure.ok()) << figure.name << ": " << figure.value << " " << figure.unit << ", limit "
                             << *figure.limit;
}

TEST(RemovalFigures, CanBeInterrupted) {
  const std::atomic<bool> stop = true;
  const auto figures = removal_figures(Progress({}, &stop));
  ASSERT_FALSE(figures.ok());
  EXPECT_EQ(figures.error().kind, ErrorKind::kInterrupted);
}

}  // namespace
}  // namespace palpate
