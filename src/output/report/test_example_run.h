#pragma once

#include "palpate/contact/model.h"
#include "palpate/recording/recording.h"
#include "palpate/rehearsal/plan_in_scene.h"

/// Synthetic left knee of spheres and capsules, and a synthetic run on it, for tests of the page. Their
/// figures are known exactly, and no servo is needed.
namespace palpate::report::example {

inline constexpr LabelId kFemoralCartilage = 83, kFemur = 95, kTibia = 96, kFibula = 97, kPatella = 98;

/// Labels and scan on a left-handed grid with 1.5 mm voxels around the origin. Without a field.
Model model();

/// Approaches, presses, strokes and leaves each structure in turn, at 1 kHz: tibia, femoral cartilage,
/// patella, fibula. The force is 2 N per mm of depth, clamped to `limit_N`.
Recording recording(const Model& model, double limit_N = 1.5);

/// The same run on the real clock: 8 to 16 us late, 300 us once a second, once 3.4 ms; six stale ticks;
/// emergency stop in the last 200 ticks; three missing ticks.
Recording real_recording(const Model& model);

/// The model with the upper half of its tibia deformable (60 kPa), and a ball of 4 mm as the tool.
Model with_soft_tibia(Model model);
/// The first run as recorded by the proxy, with all contacts and force contributions: within the tibia the
/// soft part and, deeper than 0.3 mm, the femur.
Recording leaning_recording(const Model& model);

/// The model with a burr of 4 mm as the tool.
Model with_burr(Model model);
/// The first run with that burr. Its motor runs for a second each while the tibia and the patella are
/// pressed, and the burr removes the tissue in its path: versions 2 ... 51 of the model.
Recording milled_recording(const Model& model);

/// A plan with a trajectory into the patella, a millimetre from where the first run presses it, a ball to be
/// removed there, and a required clearance from the fibula, which the run violates.
PlanInScene plan(const Model& model);

}  // namespace palpate::report::example
