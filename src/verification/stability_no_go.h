#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/device/simulated_device.h"
#include "palpate/haptics/haptics.h"
#include "palpate/verification/verification.h"

namespace palpate {

/// What is kept away from: behind x = 0, from 0 mm on.
enum class NoGoPlace : std::uint8_t {
  kPlane,      ///< a plane, where nothing is felt
  kStructure,  ///< the labels of a wall, which are not felt
  kFelt,       ///< the same, which is felt as well, with friction
};
/// "plane", "structure", "felt-wall"
const char* name_of(NoGoPlace place);
/// A region of that kind with that stiffness, N/mm. Errors: kInterrupted.
/// @param labels  a wall that ends at x = 0: flat_wall_labels(), thick_wall_labels()
Result<std::shared_ptr<const Model>> no_go_wall(NoGoPlace place, double stiffness_N_per_mm,
                                                const LabelMap& labels, const Progress& progress = {});

/// A hand that leads the tip against such a region.
struct LedAgainst {
  PlantDevice device;
  PlantHand hand;
  double rate_hz = 1000, delay_s = 1e-3;
  double stiffness_N_per_mm = 1;  ///< that the hand feels: it caps the region's
  double speed_mm_s = 100;
  double press_N = 1;   ///< that the hand bears at rest, besides the device's Coulomb friction
  bool slides = false;  ///< it goes 8 mm along the border after a second, and comes to rest again
};
/// What became of it.
struct HeldOff {
  double past_mm = 0;    ///< the deepest that the true tip was behind the border, less force over stiffness
  double force_N = 0;    ///< the most that was sent
  bool clamped = false;  ///< the device could not give all that was asked
  double swing_mm = 0;   ///< peak to peak of the tip in the last second, at rest
};
/// Through the real tick. @param stiffness_N_per_mm  of the spring at the border, as it is felt
HeldOff lead_against(const Model& model, const LedAgainst& led, double stiffness_N_per_mm);

/// At 0.1 m/s against all three, by both devices and every documented hand, at 1 and 4 kHz and at 250 Hz, at
/// what is recommended for one tick of delay. Errors: kInterrupted.
Result<std::vector<Figure>> no_go_figures(const Progress& progress);

}  // namespace palpate
