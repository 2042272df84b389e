#pragma once

#include <cmath>
#include <memory>
#include <vector>

#include "contact/test_model.h"
#include "palpate/servo/servo.h"
#include "palpate/tissue/carving.h"

/// A burr that a test guides through the complete tick.
namespace palpate::testing {

inline constexpr double kBurrRadius_mm = 2, kBurrTick_s = 1e-3;

inline Model burr_model(double spacing_mm = 1) {
  Model model = with_exact_surfaces(ball_model({spacing_mm, spacing_mm, spacing_mm}));
  model.tools[0].radius_mm = kBurrRadius_mm;
  model.tools[0].burr = BurrSettings{.spindle = Eigen::Vector3d(1, 0, 0)};
  return model;
}

/// A single device moved by the test, and a session that carves.
struct GuidedSession {
  std::shared_ptr<const Model> model;
  std::shared_ptr<const Carving> carving;
  Parameters parameters;
  SessionState state;
  TickRecord record;
  Wrench wrench;
  DeviceState device;

  explicit GuidedSession(const Model& guided = burr_model())
      : model(std::make_shared<const Model>(guided)), carving(std::make_shared<const Carving>(guided)) {
    parameters.method = ForceMethod::kProxy;
    parameters.motor = true;
    parameters.viscosity = false;
    parameters.max_force_N = 10;
    state.device[0].output.gain = 1;
    device.tip = above(5);
    tick_once();
  }
  // tip position at which the burr's surface is `clear_mm` above the ball
  Point<World> above(double clear_mm, double x_mm = 0) const {
    const double r = kBoneRadius_mm + kBurrRadius_mm + clear_mm;
    return model->X_WorldPatient * Point<Patient>(x_mm, 0, std::sqrt(r * r - x_mm * x_mm));
  }
  void tick_once() { tick(*model, parameters, {&device, 1}, kBurrTick_s, state, {&wrench, 1}, record); }
  void lead_to(const Point<World>& to, int ticks) {
    const Vector<World> step = (to - device.tip) / ticks;
    for (int n = 0; n < ticks; ++n) {
      device.tip += step;
      tick_once();
    }
  }
  const BurrState& burr() const { return state.device[0].burr; }
  // carves as a session does; returns false if there were no new cuts
  bool carve() {
    const std::vector<Cut> cuts = finished_cuts(burr(), 0);
    if (cuts.empty()) return false;
    carving = carving->with(cuts);
    model = carving->applied_to(*model);
    return true;
  }
};

}  // namespace palpate::testing
