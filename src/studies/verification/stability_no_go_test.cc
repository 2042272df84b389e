#include "verification/stability_no_go.h"

#include <gtest/gtest.h>

#include <cmath>

#include "palpate/servo/servo.h"
#include "palpate/stability/stability.h"
#include "verification/stability_dropout.h"
#include "verification/stability_wall.h"

namespace palpate {
namespace {

constexpr double kHeld_N_per_mm = 1.2, kContact_N_per_mm = 0.9 * kHeld_N_per_mm;

const Model& stiff_no_go(NoGoKind kind) {
  static const LabelMap labels = thick_wall_labels();
  static const std::array models{no_go_wall(NoGoKind::kPlane, 20, labels),
                                 no_go_wall(NoGoKind::kStructure, 20, labels),
                                 no_go_wall(NoGoKind::kTouchable, 20, labels)};
  const auto& model = models[static_cast<std::size_t>(kind)];
  PALPATE_CHECK(model.ok());
  return **model;
}

TEST(StabilityNoGo, AHandGuidedAgainstARegionIsHeldAtItsBorderAndRests) {
  for (const NoGoKind kind : {NoGoKind::kPlane, NoGoKind::kStructure, NoGoKind::kTouchable})
    for (const PlantDevice& device : known_plant_devices())
      for (const PlantHand& hand : known_plant_hands())
        for (const double rate_hz : {1000.0, 4000.0}) {
          SCOPED_TRACE(std::string(name_of(kind)) + ", " + device.name + ", " + hand.name + ", " +
                       std::to_string(rate_hz));
          if (rate_hz > 1000 && kind != NoGoKind::kStructure) continue;
          const NoGoResult result = run_no_go_approach(
              stiff_no_go(kind),
              {device, hand, rate_hz, 1 / rate_hz, kHeld_N_per_mm, 100, 1, kind == NoGoKind::kTouchable},
              kContact_N_per_mm);
          // a Touch cannot stop a whole arm at 0.1 m/s
          EXPECT_TRUE(result.past_mm < 0.5 ||
                      (result.clamped && device.name == "touch" && hand.name == "whole-arm"))
              << result.past_mm << " mm, " << result.force_N << " N, " << result.clamped;
          EXPECT_GT(result.force_N, 0.9) << "it is met";
          EXPECT_LE(result.swing_mm, 2e3 * device.encoder_step_m);
        }
}

// with a low stable stiffness a hand sinks in by a centimetre, exactly as far as force and stiffness imply,
// and rests
TEST(StabilityNoGo, TheSlowestLoopHoldsAHandAtTheBorder) {
  constexpr double kMinRate_hz = 250;
  for (const PlantDevice& device : known_plant_devices()) {
    const auto limit = recommended_stiffness_N_per_mm(device, kMinRate_hz, 1 / kMinRate_hz);
    ASSERT_TRUE(limit);
    for (const NoGoKind kind : {NoGoKind::kPlane, NoGoKind::kStructure, NoGoKind::kTouchable})
      for (const PlantHand& hand : known_plant_hands()) {
        SCOPED_TRACE(std::string(name_of(kind)) + ", " + device.name + ", " + hand.name);
        const NoGoResult result = run_no_go_approach(
            stiff_no_go(kind),
            {device, hand, kMinRate_hz, 1 / kMinRate_hz, *limit, 100, 1, kind == NoGoKind::kTouchable},
            0.9 * *limit);
        EXPECT_LT(result.past_mm, 0.5);
        EXPECT_GT(result.force_N, 0.9) << "it is met";
        EXPECT_FALSE(result.clamped);
        EXPECT_LE(result.swing_mm, 2e3 * device.encoder_step_m);
      }
  }
}

TEST(StabilityNoGo, CoincidentRegionAddsNoStiffness) {
  // pressed by a prescribed tip: the total normal force is that of the stiffer of the two
  const Model& model = stiff_no_go(NoGoKind::kTouchable);
  Parameters parameters;
  parameters.method = ForceMethod::kProxy;
  parameters.friction = parameters.viscosity = parameters.passivity = false;
  parameters.max_force_N = 8;
  parameters.device[0].max_stiffness_N_per_mm = kHeld_N_per_mm;
  SessionState state;
  state.device[0].output.gain = 1;
  TickRecord record;
  Wrench sent;
  const SurfaceTree& wall = *model.distance_trees.structures()[0].tree;
  double last_N = 0;
  for (double x_mm = 1; x_mm > -2; x_mm -= 0.02) {
    const Point<Patient> tip(x_mm, 0.3, 0.2);
    DeviceState sensed;
    sensed.tip = model.X_WorldPatient * tip;
    tick(model, parameters, {&sensed, 1}, 1e-3, state, {&sent, 1}, record);
    const double stiffer = std::max(kContact_N_per_mm, 1.0);
    const double depth_mm = -wall.nearest(tip)->distance_mm;
    EXPECT_NEAR(sent.force_N.norm(), stiffer * std::max(0.0, depth_mm), 0.08) << x_mm;
    EXPECT_LE(sent.force_N.norm() - last_N, 0.02 * kHeld_N_per_mm + 0.02) << "no step, " << x_mm;
    last_N = sent.force_N.norm();
    EXPECT_EQ((record.device[0].flags & kFlagNoGo) != 0, record.device[0].no_go == 1);
  }
  EXPECT_EQ(record.device[0].no_go, 1);
  EXPECT_NEAR(record.device[0].no_go_depth_mm, 2, 0.3);
}

TEST(StabilityNoGo, ComesInByTheRampAfterAStop) {
  const Model& model = stiff_no_go(NoGoKind::kStructure);
  Parameters parameters;
  parameters.device[0].max_stiffness_N_per_mm = kHeld_N_per_mm;
  parameters.emergency_stop = true;
  SessionState state;
  TickRecord record;
  Wrench sent;
  DeviceState sensed;
  sensed.tip = model.X_WorldPatient * Point<Patient>(-1, 0, 0);
  double last_N = 0;
  for (int n = 0; n < 800; ++n) {
    parameters.emergency_stop = n < 100;
    tick(model, parameters, {&sensed, 1}, 1e-3, state, {&sent, 1}, record);
    const double force_N = sent.force_N.norm();
    if (n < 100) {
      EXPECT_EQ(force_N, 0) << n;
    }
    EXPECT_LE(force_N - last_N, 0.02) << "no kick, " << n;
    EXPECT_NE(record.device[0].flags & kFlagNoGo, 0u) << "told while it is stopped, too";
    last_N = force_N;
  }
  EXPECT_NEAR(last_N, kContact_N_per_mm * record.device[0].no_go_depth_mm, 0.05);
}

TEST(StabilityNoGo, HoldsAgainAfterADropout) {
  for (const NoGoKind kind : {NoGoKind::kPlane, NoGoKind::kStructure}) {
    const auto model = no_go_wall(kind, 1, flat_wall_labels());
    ASSERT_TRUE(model.ok());
    for (const char* hand : {"light-grip", "firm-grip"}) {
      SCOPED_TRACE(std::string(name_of(kind)) + ", " + hand);
      const DropoutResult lost =
          drop_out(**model, {*find_plant_device("premium-1.5"), *find_plant_hand(hand), 1.16, 1e-3, 20e-3});
      EXPECT_NEAR(lost.before_N, 1, 0.2);
      EXPECT_TRUE(lost.silent);
      EXPECT_LT(lost.sinking_mm, 1.3) << "as of a felt wall";
      EXPECT_LT(lost.back_s, 0.1);
      EXPECT_LE(lost.kick_N, 0.2);
    }
  }
}

}  // namespace
}  // namespace palpate
