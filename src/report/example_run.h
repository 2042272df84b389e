#pragma once

#include "palpate/haptics/haptics.h"
#include "palpate/recording/recording.h"
#include "palpate/rehearsal/plan_in_scene.h"

/// A made-up left knee of spheres and capsules, and a made-up run over it, for the tests of the page: what
/// is in them is known exactly, and they need no servo.
namespace palpate::report::example {

inline constexpr LabelId kFemoralCartilage = 83, kFemur = 95, kTibia = 96, kFibula = 97, kPatella = 98;

/// Labels and scan on a left-handed grid of 1.5 mm voxels around the origin. No field.
Model model();

/// Every structure approached, pressed, stroked and left in turn, at 1 kHz: tibia, femoral cartilage,
/// patella, fibula, with a force of 2 N/mm of depth clamped to `limit_N`.
Recording recording(const Model& model, double limit_N = 1.5);

/// The same on the real clock: late by 8 to 16 us, by 300 us once a second, once by 3.4 ms; six stale ticks;
/// emergency stop in the last 200 ticks; three points in time without a tick.
Recording real_recording(const Model& model);

/// The model with the upper half of its tibia soft, of 60 kPa, and yielding, and a ball of 4 mm for its tool.
Model with_soft_tibia(Model model);
/// The first run as the proxy's ticks tell it, with all that it leans on and what gave its force: in the
/// tibia the soft one and, beyond 0.3 mm, the femur.
Recording leaning_recording(const Model& model);

/// The model with a burr for its tool, of 4 mm.
Model with_burr(Model model);
/// The first run with that burr, whose motor runs for a second each while the tibia and the patella are
/// pressed, and takes what it is led through: versions 2 ... 51 of the model.
Recording milled_recording(const Model& model);

/// A plan of a way into the patella, a millimetre beside where the first run presses it, of a ball to be
/// taken off there, and of a distance from the fibula, which is not kept.
PlanInScene plan(const Model& model);

}  // namespace palpate::report::example
