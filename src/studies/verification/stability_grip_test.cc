#include "verification/stability_grip.h"

#include <gtest/gtest.h>

#include "palpate/device/bounds.h"
#include "palpate/device/device_parameters.h"
#include "palpate/stability/stability.h"
#include "verification/stability_wall.h"

namespace palpate {
namespace {

const Model& grip_wall() {
  static const auto wall = flat_wall();
  PALPATE_CHECK(wall.ok());
  return **wall;
}

// A fingertip on the device adds almost no mass: in a viscous gland it oscillates unless the viscosity is
// clamped to the device's limit.
TEST(StabilityGrip, AViscousTissueIsQuietUnderAFingertip) {
  for (const char* name : {"premium-1.5", "touch"})
    for (const double delay_s : {1e-3, 3e-3})
      for (const double stiffness_N_per_mm : {0.1, 0.4})
        for (const double damping_N_s_per_m : {0.1, 2.0}) {
          SCOPED_TRACE(std::string(name) + ", " + std::to_string(delay_s) + " s, " +
                       std::to_string(stiffness_N_per_mm) + " N/mm, " + std::to_string(damping_N_s_per_m));
          GripCase grip_case{.device = *find_plant_device(name),
                             .grip = {.mass_kg = 0.01, .damping_N_s_per_m = damping_N_s_per_m},
                             .stiffness_N_per_mm = stiffness_N_per_mm,
                             .viscosity_N_s_per_mm = 0.05,
                             .delay_s = delay_s,
                             .press_N = 0.5,
                             .time_s = 2};
          if (stiffness_N_per_mm == 0.1) {
            EXPECT_GT(hold_wall(grip_wall(), grip_case).swing_mm, 0.4) << "as it is asked for";
          }
          grip_case.max_damping_N_s_per_mm = recommended_damping_N_s_per_mm(grip_case.device, 1000, delay_s);
          EXPECT_LT(hold_wall(grip_wall(), grip_case).swing_mm, 2e3 * grip_case.device.encoder_step_m);
        }
}

// grips with little damping, at the stiffness recommended for the documented ones: without the controller
// they oscillate indefinitely
std::vector<Grip> loose_grips() {
  std::vector<Grip> grips;
  for (const double damping_N_s_per_m : {0.3, 0.5})
    for (const double stiffness_N_per_m : {80.0, 300.0})
      for (const double mass_kg : {0.02, 0.15})
        for (const double skin_N_per_m : {0.0, 2000.0})
          grips.push_back({mass_kg, damping_N_s_per_m, stiffness_N_per_m, skin_N_per_m});
  return grips;
}

std::string name_of(const Grip& grip) {
  return std::to_string(grip.mass_kg) + " kg, " + std::to_string(grip.damping_N_s_per_m) + " N s/m, " +
         std::to_string(grip.stiffness_N_per_m) + " N/m, skin " + std::to_string(grip.skin_N_per_m);
}

TEST(StabilityGrip, LooseGripIsStableWithAndWithoutReportedDelay) {
  int swinging = 0;
  for (const Grip& grip : loose_grips()) {
    SCOPED_TRACE(name_of(grip));
    GripCase grip_case{.device = *find_plant_device("premium-1.5"), .grip = grip, .stiffness_N_per_mm = 1.16};
    grip_case.controller = false;
    swinging += hold_wall(grip_wall(), grip_case).swing_mm > 0.2;
    grip_case.controller = true;
    for (const bool reported : {false, true}) {
      SCOPED_TRACE(reported ? "told" : "not told");
      grip_case.reported_s = reported ? grip_case.delay_s : 0;
      const GripResult result = hold_wall(grip_wall(), grip_case);
      EXPECT_LT(result.swing_mm, 2e3 * grip_case.device.encoder_step_m);
      EXPECT_LT(result.settled_s, reported ? 1.2 : 0.9) << "after an impact at 0.1 m/s";
      EXPECT_NEAR(result.force_N, 1, 0.2) << "the wall is there";
    }
  }
  EXPECT_GE(swinging, 12) << "of 16";
}

// With compliant skin, the small mass of the device oscillates against delayed damping.
TEST(StabilityGrip, RecommendedStiffnessIsStableWithASkinModel) {
  for (const PlantDevice& device : known_plant_devices())
    for (const double rate_hz : {1000.0, 250.0})
      for (const double delay_s : {0.0, 1e-3, 4e-3}) {
        const double stiffness_N_per_mm = *recommended_stiffness_N_per_mm(device, rate_hz, delay_s);
        for (const PlantHand& hand : plant_hands_with_skin())
          for (const double impact_m_s : {0.05, 0.5}) {
            SCOPED_TRACE(device.name + ", " + hand.name + ", " + std::to_string(rate_hz) + " Hz, " +
                         std::to_string(delay_s) + " s, " + std::to_string(impact_m_s) + " m/s");
            const GripCase grip_case{.device = device,
                                     .grip = grip_of(hand),
                                     .stiffness_N_per_mm = stiffness_N_per_mm,
                                     .rate_hz = rate_hz,
                                     .delay_s = delay_s,
                                     .impact_m_s = impact_m_s};
            const GripResult result = hold_wall(grip_wall(), grip_case);
            EXPECT_LE(result.swing_mm, 2e3 * device.encoder_step_m);
            EXPECT_NEAR(result.force_N, 1, 0.35) << "the wall is there, and friction bears the rest";
          }
      }
}

// Free device without friction. The stiffest wall of each device is the recommended one.
TEST(StabilityGrip, AFreeTapReboundsNoFasterThanItCame) {
  const struct {
    const char* device;
    double stiffness_N_per_mm;
  } walls[] = {{"premium-1.5", 1.16}, {"touch", 1.16}, {"touch", 5.01}};
  for (const auto& [device, stiffness_N_per_mm] : walls)
    for (const double mass_kg : {0.001, 0.15})
      for (const double impact_m_s : {0.05, 0.1, 0.2}) {
        SCOPED_TRACE(std::string(device) + ", " + std::to_string(stiffness_N_per_mm) + " N/mm, " +
                     std::to_string(mass_kg) + " kg, " + std::to_string(impact_m_s));
        GripCase tap{.device = *find_plant_device(device),
                     .grip = {.mass_kg = mass_kg},
                     .stiffness_N_per_mm = stiffness_N_per_mm,
                     .press_N = 0,
                     .impact_m_s = impact_m_s,
                     .free = true,
                     .time_s = 0.2};
        tap.device.coulomb_N = tap.device.damping_N_s_per_m = 0;
        const double reported = hold_wall(grip_wall(), tap).rebound;
        // at higher speed there are fewer ticks to estimate the mass
        EXPECT_LE(reported, impact_m_s > 0.1 ? 1.1 : 1);
        EXPECT_GT(reported, 0.5) << "and is a wall";
        tap.controller = false;
        EXPECT_GT(hold_wall(grip_wall(), tap).rebound, 1);
      }
}

// For a physical device that declares only its rate, stiffness and latency are assumed conservatively.
TEST(StabilityGrip, TapOfAnUnknownDeviceGainsNoSpeed) {
  for (const double rate_hz : {250.0, 1000.0, 4000.0}) {
    DeviceInfo info;
    info.rate_hz = rate_hz;
    for (const char* device : {"premium-1.5", "touch"})
      for (const double delay_s : {0.0, 1e-3, 2e-3, 3e-3, 4e-3})
        for (const double mass_kg : {0.001, 0.15})
          for (const double impact_m_s : {0.05, 0.1, 0.2}) {
            SCOPED_TRACE(std::string(device) + ", " + std::to_string(rate_hz) + " Hz, " +
                         std::to_string(delay_s) + " s, " + std::to_string(mass_kg) + " kg, " +
                         std::to_string(impact_m_s));
            GripCase tap{.device = *find_plant_device(device),
                         .grip = {.mass_kg = mass_kg},
                         .stiffness_N_per_mm = stiffness_bound_N_per_mm(info),
                         .rate_hz = rate_hz,
                         .delay_s = delay_s,
                         .states_nothing = true,
                         .press_N = 0,
                         .impact_m_s = impact_m_s,
                         .free = true,
                         .time_s = 0.4};
            tap.device.coulomb_N = tap.device.damping_N_s_per_m = 0;
            const double rebound = hold_wall(grip_wall(), tap).rebound;
            EXPECT_LE(rebound, delay_s < ConservativeDevice{}.delay_s ? 1 : 1.05);
            EXPECT_GT(rebound, 0.4) << "and is a wall";
          }
  }
}

// the decaying oscillation of documented hands after an impact is not mistaken for a limit cycle: their wall
// is not softened
TEST(StabilityGrip, DocumentedGripsPressWithoutVibration) {
  for (const PlantHand& hand : known_plant_hands()) {
    SCOPED_TRACE(hand.name);
    const GripCase grip_case{
        .device = *find_plant_device("premium-1.5"), .grip = grip_of(hand), .stiffness_N_per_mm = 1.16};
    const GripResult result = hold_wall(grip_wall(), grip_case);
    EXPECT_EQ(result.swing_mm, 0);
    EXPECT_NEAR(result.force_N, 1, 0.06);
  }
}

}  // namespace
}  // namespace palpate
