#include "verification/stability_energy.h"

#include <gtest/gtest.h>

#include "palpate/model/make_model.h"
#include "palpate/stability/hold.h"
#include "palpate/stability/stability.h"
#include "verification/stability_wall.h"

namespace palpate {
namespace {

// A minute without delay at the recommended stiffness.
void expect_little_energy_generated(const std::string& device_name, const std::string& grip,
                                    double max_damped, double max_deeper_mm) {
  const auto ball = exploration_ball();
  ASSERT_TRUE(ball) << ball.error().message();
  const PlantDevice device = *find_plant_device(device_name);
  const auto stiffness = recommended_stiffness_N_per_mm(device, 1000, 0);
  ASSERT_TRUE(stiffness);
  for (const ForceMethod method : {ForceMethod::kProxy, ForceMethod::kTrilinear})
    for (const std::uint64_t seed : {1, 2, 3, 4}) {
      SCOPED_TRACE(device_name + " " + grip + " " + std::string(name_of(method)) + ", seed " +
                   std::to_string(seed));
      Exploration exploration{device, *find_plant_hand(grip), method, *stiffness};
      exploration.seed = seed;
      const EnergyBalance with = simulate_exploration(**ball, exploration);
      exploration.controller = false;
      const EnergyBalance without = simulate_exploration(**ball, exploration);
      EXPECT_GT(without.contacts, 20);
      EXPECT_LT(without.min_mJ, -0.5);
      EXPECT_EQ(without.damped, 0);
      EXPECT_GE(with.min_mJ, 0.05 * without.min_mJ);
      EXPECT_GE(with.min_mJ, -with.largest_force_N * 2 * device.encoder_step_m * 1e3);
      EXPECT_GT(with.damped, 0);
      // the contact is not disabled: the hand aims up to 6 mm deep
      EXPECT_LE(with.damped, max_damped);
      EXPECT_GT(with.contacts, 20);
      EXPECT_GT(with.largest_force_N, 0.9 * without.largest_force_N);
      EXPECT_LT(with.deepest_mm, without.deepest_mm + max_deeper_mm);
    }
}

TEST(StabilityEnergy, WithTheControllerAPremiumGivesOutNoMoreThanAnEncoderHides) {
  for (const char* grip : {"light-grip", "firm-grip"})
    expect_little_energy_generated("premium-1.5", grip, 0.6, 0.1);
}

// an encoder step exceeds its maximum force; the energy deficit softens the wall
TEST(StabilityEnergy, WithTheControllerATouchGivesOutNoMoreThanAnEncoderHides) {
  expect_little_energy_generated("touch", "firm-grip", 0.6, 0.1);
  expect_little_energy_generated("touch", "light-grip", 1, 0.6);
}

TEST(StabilityEnergy, ControllerLimitsReleasedEnergyOnATurningObjectAndAtTwiceTheRecommendedStiffness) {
  // a lightly held Premium, 20 s; at twice the recommended stiffness no hand is stable
  const auto ball = exploration_ball();
  ASSERT_TRUE(ball) << ball.error().message();
  const PlantDevice device = *find_plant_device("premium-1.5");
  const auto recommended_N_per_mm = recommended_stiffness_N_per_mm(device, 1000, 0);
  ASSERT_TRUE(recommended_N_per_mm);
  for (const ForceMethod method : {ForceMethod::kProxy, ForceMethod::kTrilinear})
    for (const double times : {1.0, 2.0})
      for (const bool turning : {false, true}) {
        Exploration exploration{device, *find_plant_hand("light-grip"), method,
                                times * *recommended_N_per_mm};
        exploration.turning = turning;
        exploration.time_s = 20;
        SCOPED_TRACE(std::string(name_of(method)) + ", " + std::to_string(times) +
                     " times the recommended stiffness, turning " + std::to_string(turning));
        const EnergyBalance with = simulate_exploration(**ball, exploration);
        exploration.controller = false;
        const EnergyBalance without = simulate_exploration(**ball, exploration);
        EXPECT_LT(without.min_mJ, -0.4);
        EXPECT_GE(with.min_mJ, 0.05 * without.min_mJ);
        EXPECT_GE(with.min_mJ, -with.largest_force_N * 2 * device.encoder_step_m * 1e3);
      }
}

TEST(StabilityEnergy, TheControllerMakesNoQuietContactBuzz) {
  // held with 0.8 N, below the continuous rating of both devices, at the recommended stiffness
  constexpr double kHold_N = 0.8, kBefore_mm = 3;
  const auto ball = exploration_ball();
  ASSERT_TRUE(ball);
  for (const char* device : {"premium-1.5", "touch"})
    for (const double delay_s : {0.0, 1e-3}) {
      const auto stiffness = recommended_stiffness_N_per_mm(*find_plant_device(device), 1000, delay_s);
      ASSERT_TRUE(stiffness);
      for (const char* grip : {"light-grip", "firm-grip"})
        for (const ForceMethod method : {ForceMethod::kProxy, ForceMethod::kTrilinear}) {
          SCOPED_TRACE(std::string(device) + " " + grip + " " + std::string(name_of(method)) + ", delay " +
                       std::to_string(delay_s) + " s");
          Hold hold;
          hold.device = *find_plant_device(device);
          hold.hand = *find_plant_hand(grip);
          hold.method = method;
          hold.delay_s = delay_s;
          hold.force_gain = *stiffness;
          const double spring_mm = kHold_N / *stiffness + kHold_N / (hold.hand.stiffness_N_per_m * 1e-3);
          hold.from = Point<Patient>(kBallRadius_mm + kBefore_mm, 0, 0);
          hold.at = Point<Patient>(kBallRadius_mm - spring_mm, 0, 0);
          const auto result = hold_tip(**ball, hold);
          ASSERT_TRUE(result) << result.error().message();
          EXPECT_GT(result->buzz.force_N, 0.4);
          EXPECT_TRUE(result->quiet()) << result->buzz.peak_to_peak_um << " um";
        }
    }
}

TEST(StabilityEnergy, EnergyIsBoundedByTheEncoderErrorIfTheDelayIsReported) {
  const auto ball = exploration_ball();
  ASSERT_TRUE(ball);
  const PlantDevice device = *find_plant_device("premium-1.5");
  for (const double delay_s : {1e-3, 3e-3}) {
    const auto stiffness = recommended_stiffness_N_per_mm(device, 1000, delay_s);
    ASSERT_TRUE(stiffness);
    for (const char* grip : {"light-grip", "firm-grip"}) {
      SCOPED_TRACE(std::string(grip) + ", delay " + std::to_string(delay_s) + " s");
      Exploration exploration{device, *find_plant_hand(grip), ForceMethod::kProxy, *stiffness};
      exploration.delay_s = delay_s;
      exploration.time_s = 20;
      const EnergyBalance result = simulate_exploration(**ball, exploration);
      const double hidden_mJ = result.largest_force_N * 2 * device.encoder_step_m * 1e3;
      EXPECT_GE(result.min_mJ, delay_s > 2e-3 ? -2 * hidden_mJ : -hidden_mJ);
      EXPECT_GT(result.contacts, 5);
      exploration.reported_s = 0;
      const EnergyBalance not_reported = simulate_exploration(**ball, exploration);
      EXPECT_LT(not_reported.min_mJ, -0.12);
      EXPECT_LT(result.deepest_mm, not_reported.deepest_mm + 0.1) << "the wall is as stiff";
    }
  }
}

// At tissue stiffness, where the device holds it: at 250 Hz a Premium holds 0.83 N/mm.
TEST(StabilityEnergy, UnpunctualTicksOnAPlaneAndABallKeepTheBound) {
  double generated_mJ = 0;
  const auto ball = exploration_ball(), wall = flat_wall();
  ASSERT_TRUE(ball && wall);
  for (const char* name : {"premium-1.5", "touch"})
    for (const char* grip : {"light-grip", "firm-grip"})
      for (const bool flat : {false, true})
        for (const double rate_hz : {250.0, 500.0, 1000.0, 10000.0}) {
          SCOPED_TRACE(std::string(name) + " " + grip + (flat ? ", plane, " : ", ball, ") +
                       std::to_string(rate_hz));
          const bool holds_less = rate_hz < 500 && name == std::string("premium-1.5");
          Exploration exploration{*find_plant_device(name), *find_plant_hand(grip), ForceMethod::kProxy,
                                  holds_less ? 0.83 : 1.5};
          exploration.flat = flat;
          exploration.rate_hz = rate_hz;
          exploration.jitter = 0.5;
          exploration.time_s = rate_hz > 1000 ? 2 : 15;
          const EnergyBalance with = simulate_exploration(flat ? **wall : **ball, exploration);
          EXPECT_GE(with.min_mJ, -with.largest_force_N * 2 * exploration.device.encoder_step_m * 1e3);
          EXPECT_GE(with.contacts, 1);
          exploration.controller = false;
          const EnergyBalance without = simulate_exploration(flat ? **wall : **ball, exploration);
          EXPECT_LT(with.deepest_mm, without.deepest_mm + 0.6) << "a wall still";
          generated_mJ = std::max(generated_mJ, -without.min_mJ);
        }
  EXPECT_GT(generated_mJ, 1) << "there is something to keep";
}

// a ball of quarters with seams that meet at its poles, or a soft shell around a hard core
std::shared_ptr<const Model> ball_of_several(bool layers) {
  const auto ball = exploration_ball();
  PALPATE_CHECK(ball.ok());
  const GridGeometry& grid = (*ball)->labels->geometry();
  Volume<LabelId> labels(grid);
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) {
        const Eigen::Vector3d p = (X_PatientVoxel * Point<Voxel>(i, j, k)).eigen();
        const int quarter = 1 + (p.x() > 0 ? 1 : 0) + (p.y() > 0 ? 2 : 0), layer = p.norm() < 8 ? 2 : 1;
        if (p.norm() < kBallRadius_mm) labels.at(i, j, k) = static_cast<LabelId>(layers ? layer : quarter);
      }
  ModelParts parts;
  parts.labels = label_bricks(labels);
  parts.tissue_of_label = {-1};
  const std::vector<double> stiffness =
      layers ? std::vector<double>{0.1, 1} : std::vector<double>{1, 0.6, 0.3, 0.8};
  for (const double stiffness_N_per_mm : stiffness) {
    const auto label = static_cast<LabelId>(parts.tissue_of_label.size());
    parts.segments.push_back({label, "part " + std::to_string(label), {}, 0, label});
    parts.tissue_of_label.push_back(static_cast<std::int16_t>(label - 1));
    Tissue tissue;
    tissue.name = parts.segments.back().name;
    tissue.stiffness_N_per_mm = stiffness_N_per_mm;
    parts.tissues.push_back(tissue);
  }
  parts.tools = {(*ball)->tools[0]};
  const auto made = make_model(std::move(parts));
  PALPATE_CHECK(made.ok());
  const ForceMethod proxy = ForceMethod::kProxy;
  const auto ready = prepared_for(*made, {&proxy, 1});
  PALPATE_CHECK(ready.ok());
  return *ready;
}

TEST(StabilityEnergy, UnpunctualTicksOnSeamsAndLayersKeepTheBound) {
  for (const bool layers : {false, true}) {
    const auto ball = ball_of_several(layers);
    for (const char* name : {"premium-1.5", "touch"})
      for (const char* grip : {"light-grip", "firm-grip"})
        for (const double rate_hz : {250.0, 1000.0}) {
          SCOPED_TRACE(std::string(name) + " " + grip + (layers ? ", layers, " : ", seams, ") +
                       std::to_string(rate_hz));
          const bool holds_less = rate_hz < 500 && name == std::string("premium-1.5");
          Exploration exploration{*find_plant_device(name), *find_plant_hand(grip), ForceMethod::kProxy,
                                  holds_less ? 0.83 : 1.5};
          exploration.rate_hz = rate_hz;
          exploration.jitter = 0.5;
          exploration.time_s = 15;
          const EnergyBalance with = simulate_exploration(*ball, exploration);
          EXPECT_GE(with.min_mJ, -with.largest_force_N * 2 * exploration.device.encoder_step_m * 1e3);
          EXPECT_GT(with.contacts, 3);
        }
  }
}

TEST(StabilityEnergy, AnExplorationRepeats) {
  const auto ball = exploration_ball();
  ASSERT_TRUE(ball);
  Exploration exploration{*find_plant_device("touch"), *find_plant_hand("firm-grip")};
  exploration.time_s = 3;
  const EnergyBalance once = simulate_exploration(**ball, exploration),
                      again = simulate_exploration(**ball, exploration);
  EXPECT_EQ(once.last_mJ, again.last_mJ);
  exploration.seed = 2;
  EXPECT_NE(simulate_exploration(**ball, exploration).last_mJ, once.last_mJ);
}

}  // namespace
}  // namespace palpate
