#include "verification/stability_grip.h"

#include <gtest/gtest.h>

#include "palpate/stability.h"
#include "verification/stability_wall.h"

namespace palpate {
namespace {

const Model& grip_wall() {
  static const auto wall = flat_wall();
  PALPATE_CHECK(wall.ok());
  return **wall;
}

// A fingertip that rests on the device weighs as good as nothing: in a viscous gland it swings by itself,
// unless the viscosity is clamped to what the device bears.
TEST(StabilityGrip, AViscousTissueIsQuietUnderAFingertip) {
  for (const char* name : {"premium-1.5", "touch"})
    for (const double delay_s : {1e-3, 3e-3})
      for (const double stiffness_N_per_mm : {0.1, 0.4})
        for (const double damping_N_s_per_m : {0.1, 2.0}) {
          SCOPED_TRACE(std::string(name) + ", " + std::to_string(delay_s) + " s, " +
                       std::to_string(stiffness_N_per_mm) + " N/mm, " + std::to_string(damping_N_s_per_m));
          GripCase held{.device = *find_plant_device(name),
                        .grip = {.mass_kg = 0.01, .damping_N_s_per_m = damping_N_s_per_m},
                        .stiffness_N_per_mm = stiffness_N_per_mm,
                        .viscosity_N_s_per_mm = 0.05,
                        .delay_s = delay_s,
                        .press_N = 0.5,
                        .time_s = 2};
          if (stiffness_N_per_mm == 0.1) {
            EXPECT_GT(hold_wall(grip_wall(), held).swing_mm, 0.4) << "as it is asked for";
          }
          held.most_damping_N_s_per_mm = recommended_damping_N_s_per_mm(held.device, 1000, delay_s);
          EXPECT_LT(hold_wall(grip_wall(), held).swing_mm, 2e3 * held.device.encoder_step_m);
        }
}

}  // namespace
}  // namespace palpate
