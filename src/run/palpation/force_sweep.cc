#include "palpation/force_sweep.h"

#include <algorithm>

#include "palpate/tissue/soft_tissue_solver.h"

namespace palpate {
namespace {

constexpr double kDescent_mm_s = 20;

// innermost structure along the path of the tip that contributes to the force
LabelId deepest_structure(const DeviceTick& device) {
  LabelId deepest = 0;
  for (std::size_t n = 0; n < device.path_label.size() && device.path_label[n] != 0; ++n)
    if (device.path_share[n] > 0) deepest = device.path_label[n];
  return deepest;
}

}  // namespace

std::vector<SweptForce> sweep_force(const Model& model, const Parameters& parameters,
                                    const Point<Patient>& start, const Vector<Patient>& inward, double max_mm,
                                    double rate_hz) {
  Parameters still = parameters;
  still.friction = still.viscosity = still.passivity = false;
  const bool is_deformable = is_elastic(model.tissue_law) && model.has(ForceMethod::kProxy);
  VirtualClockSoftTissueSolver solver(rate_hz);
  SessionState state;
  TickRecord record;
  DeviceState tip;
  Wrench sent;
  std::vector<SweptForce> swept;
  const double step_mm = kDescent_mm_s / rate_hz;
  double touched_mm = 0;
  for (double distance_mm = 0; distance_mm <= (swept.empty() ? max_mm : touched_mm + max_mm);
       distance_mm += step_mm) {
    tip.tip = model.X_WorldPatient * (start + inward * distance_mm);
    if (is_deformable && solver.advance(model, state.tick > 0 ? &record : nullptr))
      still.compliance = solver.frame();
    tick(model, still, {&tip, 1}, 1 / rate_hz, state, {&sent, 1}, record);
    const DeviceTick& device = record.device[0];
    const LabelId label = device.label;
    if (label == 0 && !swept.empty()) break;
    if (label == 0) continue;
    if (swept.empty()) touched_mm = distance_mm;
    swept.push_back({distance_mm - touched_mm, device.unclamped_force_N, label, deepest_structure(device)});
  }
  return swept;
}

}  // namespace palpate
