#include "servo/object_rotation.h"

#include <algorithm>
#include <cmath>

#include "palpate/device/rendered_stiffness.h"

namespace palpate {
namespace {

Eigen::Quaterniond rotation_after(const SessionState& state, double elapsed_s) {
  const double fraction = std::min(1.0, elapsed_s / kRotationSettings.interval_s);
  return Rotation<World, World>(state.rotation_start)
      .slerp(fraction, Rotation<World, World>(state.rotation_target))
      .quaternion();
}

/// Material point of the object that was under a device's tip in the last tick, and the contact there.
struct TipOnObject {
  bool has_force = false;  // whether a force is sent, or may be sent in this tick
  Vector<World> lever;     // from World's origin to the point, object not rotated, patient mm
  Vector<World> sent_N;
  double stiffness_N_per_mm = 0;  // contact stiffness at the device; 0: unknown
  double stiffest_N_per_mm = 0;   // stiffest tissue of the model, at the device
  double scale = 1;
};

TipOnObject tip_on_object(const Model& model, const DeviceParameters& parameters, const DeviceState& device,
                          const SessionState::DeviceSession& session) {
  TipOnObject tip;
  if (!session.has_previous || session.output.gain == 0 || !device.tip.all_finite() ||
      !(parameters.scale > 0))
    return tip;
  tip.has_force = true;
  tip.lever = Vector<World>((model.X_WorldPatient * session.previous_tip).eigen());
  tip.sent_N = session.output.sent.force_N;
  tip.stiffness_N_per_mm = RenderedStiffness(parameters).at_device(session.coupling.stiffness_N_per_mm);
  tip.stiffest_N_per_mm = RenderedStiffness(parameters).by_proxy(model.max_stiffness_N_per_mm());
  tip.scale = parameters.scale;
  return tip;
}

// displacement of the point when the object rotates from `from` to `to`, device mm
Vector<World> displacement_of(const TipOnObject& tip, const Eigen::Quaterniond& from,
                              const Eigen::Quaterniond& to) {
  return (Rotation<World, World>(to) * tip.lever - Rotation<World, World>(from) * tip.lever) / tip.scale;
}

// Fraction of a displacement that satisfies all limits. Against a spring the force grows along the path, so
// the work is F s + K s^2 / 2.
double allowed_fraction(const TipOnObject& tip, const Vector<World>& displacement_mm, double dt_s) {
  const double length_mm = displacement_mm.norm(), force_N = tip.sent_N.norm();
  const double max_mJ = kRotationSettings.max_power_mW * dt_s;
  double longest_mm = kRotationSettings.max_speed_mm_s * dt_s;
  if (tip.stiffest_N_per_mm > 0)
    longest_mm = std::min(longest_mm, kRotationSettings.max_step_N / tip.stiffest_N_per_mm);
  double fraction = std::min(1.0, longest_mm / std::max(length_mm, 1e-12));
  if (!(force_N > 0)) return fraction;
  const double along_mm = tip.sent_N.dot(displacement_mm) / force_N;
  if (along_mm == 0) return fraction;
  const double stiffness = along_mm > 0 ? tip.stiffness_N_per_mm : 0;
  const double max_mm = 2 * max_mJ / (force_N + std::sqrt(force_N * force_N + 2 * stiffness * max_mJ));
  return std::min(fraction, max_mm / std::abs(along_mm));
}

}  // namespace

bool is_rotation(const Eigen::Quaterniond& q) {
  const double norm = q.norm();
  return norm > 0.5 && norm < 2;
}

std::uint32_t rotate_object(const Model& model, const Parameters& parameters,
                            std::span<const DeviceState> devices, double dt_s, SessionState& state) {
  // a new command starts from the current attitude
  const Eigen::Quaterniond& target = parameters.rotation_target;
  if (target.coeffs() != state.rotation_target.coeffs() && is_rotation(target)) {
    state.rotation_start = state.rotation_applied;
    state.rotation_target = target;
    state.rotation_elapsed_s = 0;
  }
  if (state.rotation_elapsed_s >= kRotationSettings.interval_s || !(dt_s > 0)) return 0;

  // the largest rotation that every operator's limits allow
  std::array<TipOnObject, kMaxDevices> tips;
  for (std::size_t d = 0; d < devices.size(); ++d)
    tips[d] = tip_on_object(model, parameters.device[d], devices[d], state.device[d]);
  const Eigen::Quaterniond before = state.rotation_applied;
  const double within_s = std::min(dt_s, kRotationSettings.max_tick_s);
  std::uint32_t limiting_devices = 0;
  double step_s = dt_s;
  Eigen::Quaterniond rotation = rotation_after(state, state.rotation_elapsed_s + step_s);
  for (int tries = 0; tries < kRotationSettings.max_iterations; ++tries) {
    double fraction = 1;
    for (std::size_t d = 0; d < devices.size(); ++d) {
      if (!tips[d].has_force) continue;
      const double device_fraction =
          allowed_fraction(tips[d], displacement_of(tips[d], before, rotation), within_s);
      if (device_fraction < 1) limiting_devices |= 1u << d;
      fraction = std::min(fraction, device_fraction);
    }
    if (fraction >= 1 - 1e-6) break;
    step_s *= fraction;
    rotation = rotation_after(state, state.rotation_elapsed_s + step_s);
  }

  // work on the operators
  for (std::size_t d = 0; d < devices.size(); ++d)
    if (tips[d].has_force)
      state.device[d].turned_mJ += tips[d].sent_N.dot(displacement_of(tips[d], before, rotation));
  state.rotation_elapsed_s += step_s;
  state.rotation_applied = rotation;
  return limiting_devices;
}

}  // namespace palpate
