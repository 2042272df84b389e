#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/contact/model.h"
#include "palpate/device/simulated_device.h"
#include "palpate/verification/verification.h"
#include "palpate/volume/label_map.h"

namespace palpate {

/// Kind of no-go region; it occupies x < 0, with a clearance of 0 mm.
enum class NoGoKind : std::uint8_t {
  kPlane,      ///< Half-space bounded by a plane, without touchable tissue
  kStructure,  ///< Labels of a wall that is not touchable
  kTouchable,  ///< Labels of a wall that is touchable, with friction
};
/// Name in figures, e.g. "plane", "structure", "felt-wall"
const char* name_of(NoGoKind kind);
/// Model with a region of that kind and stiffness, N/mm. Errors: kInterrupted.
/// @param labels  a wall that ends at x = 0: flat_wall_labels(), thick_wall_labels()
Result<std::shared_ptr<const Model>> no_go_wall(NoGoKind kind, double stiffness_N_per_mm,
                                                const LabelMap& labels, const Progress& progress = {});

/// A hand that moves the tip against such a region.
struct NoGoApproach {
  PlantDevice device;
  PlantHand hand;
  double rate_hz = 1000, delay_s = 1e-3;
  double stiffness_N_per_mm = 1;  ///< Rendered at the device, if it limits the region's stiffness
  double speed_mm_s = 100;
  double press_N = 1;   ///< Force of the hand at rest, in addition to the device's Coulomb friction
  bool slides = false;  ///< Whether it moves 8 mm along the boundary after a second, and then rests again
};
/// Result of the motion.
struct NoGoResult {
  double past_mm = 0;    ///< Maximum depth of the true tip beyond the boundary, minus force over stiffness
  double force_N = 0;    ///< Maximum force sent
  bool clamped = false;  ///< Whether the force was limited by the device
  double swing_mm = 0;   ///< Peak-to-peak motion of the tip in the last second, at rest
};
/// Runs the motion through the real tick.
/// @param stiffness_N_per_mm  of the spring at the boundary, rendered at the device
NoGoResult run_no_go_approach(const Model& model, const NoGoApproach& approach, double stiffness_N_per_mm);

/// Figures at 0.1 m/s against all three kinds, for both devices and every documented hand, at 250 Hz, 1 kHz
/// and 4 kHz, at the stiffness recommended for a delay of one tick. Errors: kInterrupted.
Result<std::vector<Figure>> no_go_figures(const Progress& progress);

}  // namespace palpate
