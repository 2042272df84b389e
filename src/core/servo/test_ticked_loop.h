#pragma once

#include <limits>

#include "contact/test_model.h"
#include "palpate/servo/servo.h"

/// Loops of a single device that a test ticks by itself.
namespace palpate::testing {

inline constexpr double kMillisecond_s = 1e-3;

/// A single device, ticked at given tip positions, with an output stage that does not ramp, slew or damp
/// unless a test configures it.
struct TickedLoop {
  Model model = ball_model();
  Parameters parameters;
  SessionState state;
  TickRecord record;
  Wrench wrench;

  TickedLoop() {
    state.device[0].output.gain = 1;
    parameters.passivity = false;
    parameters.device[0].limits.slew_N_per_s = std::numeric_limits<double>::infinity();
    parameters.device[0].limits.peak_torque_Nmm = 1000;
  }
  void at(const DeviceState& device) {
    tick(model, parameters, {&device, 1}, kMillisecond_s, state, {&wrench, 1}, record);
  }
  void at(const Point<World>& tip) {
    DeviceState device;
    device.tip = tip;
    at(device);
  }
  // farther than the jump threshold of one tick
  void set_down_at(const Point<World>& tip) {
    state.device[0].has_previous = false;
    at(tip);
  }
};

/// A loop that uses the proxy method.
struct ProxyLoop : TickedLoop {
  explicit ProxyLoop(double cartilage_mm = 0) {
    model = testing::with_exact_surfaces(ball_model({0.6, 0.6, 0.9}, 1.0, cartilage_mm), cartilage_mm);
    parameters.method = ForceMethod::kProxy;
    parameters.max_force_N = 100;
  }
  void lead(const Point<World>& from, const Point<World>& to, int ticks) {
    for (int n = 1; n <= ticks; ++n) at(from + (to - from) * (static_cast<double>(n) / ticks));
  }
};

}  // namespace palpate::testing
