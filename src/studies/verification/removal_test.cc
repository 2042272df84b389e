#include "verification/removal.h"

#include <gtest/gtest.h>

#include <atomic>

#include "base/test_seed.h"
#include "palpate/stability/stability.h"
#include "verification/removal_plants.h"
#include "verification/removal_thin.h"
#include "verification/removal_volumes.h"
#include "verification/stability_energy.h"

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
TEST(ThinBone, FiguresAreWithinLimits) {
  const auto figures = thin_bone_figures({.all = false, .cut_s = 0.2}, {});
  ASSERT_TRUE(figures.ok());
  EXPECT_EQ(figures->size(), 2);
  for (const Figure& figure : *figures)
    EXPECT_TRUE(figure.ok()) << figure.name << ": " << figure.value << " " << figure.unit << ", limit "
                             << *figure.limit;
}

// between air cells, where no sampling direction may meet bone
TEST(ThinBone, APressedBurrDoesNotStandStill) {
  const unsigned seed = test::test_seed();
  for (const double voxel_mm : {0.4, 0.6, 0.8})
    for (unsigned run = 0; run < 3; ++run) {
      const auto rest_s = longest_rest_s(voxel_mm, seed + run, 2);
      ASSERT_TRUE(rest_s.ok());
      EXPECT_LT(*rest_s, 0.1) << "voxels of " << voxel_mm << " mm, seed " << seed + run;
    }
}

// every simulated hand on every simulated device: what the world gives out is what an encoder step hides, at
// most
TEST(CuttingPlants, AVibratingBurrGivesNothingOut) {
  const auto wall = wall_for_burr();
  ASSERT_TRUE(wall.ok());
  for (const PlantDevice& device : known_plant_devices()) {
    const auto stiffness = recommended_stiffness_N_per_mm(device, 1000, 0, {});
    ASSERT_TRUE(stiffness.ok());
    for (const PlantHand& hand : known_plant_hands())
      for (const double revolutions_per_min : {60000.0, 2500.0})
        for (const bool presses : {false, true}) {
          Model model = *wall;
          model.tools[0].burr->revolutions_per_s = revolutions_per_min / 60;
          if (revolutions_per_min < 10000) model.tools[0].burr->flutes = 2;
          Exploration exploration{device, hand};
          exploration.stiffness_N_per_mm = *stiffness;
          exploration.flat = exploration.cuts = exploration.vibrates = true;
          exploration.presses = presses;
          exploration.time_s = 2;
          const EnergyBalance balance = simulate_exploration(model, exploration);
          const double hidden_mJ = balance.largest_force_N * 2 * device.encoder_step_m * 1e3;
          EXPECT_LE(-balance.min_mJ, hidden_mJ)
              << device.name << " " << hand.name << " " << revolutions_per_min << (presses ? " presses" : "");
          EXPECT_GT(balance.last_mJ, 0);
        }
  }
}

TEST(RemovalFigures, CanBeInterrupted) {
  const std::atomic<bool> stop = true;
  const auto figures = removal_figures(Progress({}, &stop));
  ASSERT_FALSE(figures.ok());
  EXPECT_EQ(figures.error().kind, ErrorKind::kInterrupted);
}

}  // namespace
}  // namespace palpate
