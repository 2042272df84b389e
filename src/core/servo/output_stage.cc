#include "servo/output_stage.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "palpate/device/telemetry.h"
#include "palpate/tissue/protected_distance.h"

namespace palpate {

static_assert(kOutputSettings.stale_s == kCuttingSettings.motor_timeout_s);
namespace {

Wrench scale_wrench(const Wrench& w, double factor) {
  return {w.force_N * factor, w.torque_Nmm * factor, w.gripper_N * factor};
}

bool all_finite(const Wrench& w) {
  return w.force_N.all_finite() && w.torque_Nmm.all_finite() && std::isfinite(w.gripper_N);
}

// vector norm without overflow or underflow of the square
double magnitude(const Vector<World>& v) {
  constexpr double kMinSquare = 1e-200, kMaxSquare = 1e200;
  const double square = v.squared_norm();
  if (square > kMinSquare && square < kMaxSquare) return std::sqrt(square);
  const double largest = v.eigen().cwiseAbs().maxCoeff();
  return largest > 0 ? largest * (v / largest).norm() : 0;
}

// Usable value of a limit, clamped to 0 or [kMinLimit, kMaxLimit]. NaN, infinite, negative and imperceptibly
// small limits count as 0; kMaxLimit is far above any device's. Squares and differences of values in this
// range neither overflow nor vanish.
double sanitised_limit(double limit) {
  constexpr double kMinLimit = 1e-9, kMaxLimit = 1e6;
  return limit >= kMinLimit && std::isfinite(limit) ? std::min(limit, kMaxLimit) : 0;
}

// factor that scales a magnitude down to its limit; slightly smaller, so that rounding never exceeds the
// limit
double factor_to(double limit, double magnitude) {
  return magnitude > limit ? limit / magnitude * (1 - 0x1p-50) : 1;
}

double configured_limit_N(const OutputLimits& limits, double max_force_N) {
  return std::isnan(limits.peak_force_N)
             ? sanitised_limit(max_force_N)
             : std::min(sanitised_limit(max_force_N), sanitised_limit(limits.peak_force_N));
}

// Thermal model: heat follows (F / continuous force)^2 with time constant thermal_s; 1 is the steady state at
// the continuous force. The rest of the budget may be spent within thermal_taper_s, so that heat never
// exceeds 1 and the limit decreases smoothly to the continuous force.
double thermal_limit_N(const OutputLimits& limits, double heat, double dt_s) {
  if (std::isnan(limits.continuous_force_N)) return std::numeric_limits<double>::infinity();
  const double power =
      heat + (1 - heat) * kOutputSettings.thermal_s / std::max(dt_s, kOutputSettings.thermal_taper_s);
  return sanitised_limit(limits.continuous_force_N) * std::sqrt(power);
}

double next_heat(const OutputLimits& limits, double heat, double force_N, double dt_s) {
  const double continuous_N = sanitised_limit(limits.continuous_force_N);
  if (continuous_N == 0) return heat;
  const double power = force_N / continuous_N * (force_N / continuous_N);
  return std::min(1.0, heat + (power - heat) * std::min(1.0, dt_s / kOutputSettings.thermal_s));
}

double freshness_at(double age_s) {
  if (!(age_s >= -kOutputSettings.clock_jitter_s)) return 0;
  return std::clamp((kOutputSettings.stale_s - age_s) / (kOutputSettings.stale_s - kOutputSettings.fresh_s),
                    0.0, 1.0);
}

// fraction of the change from `sent` to `requested` that one tick may apply
double slew_fraction(const Wrench& sent, const Wrench& requested, const OutputLimits& limits,
                     double slew_N_per_s, double dt_s) {
  const auto fraction_within = [](double distance, double largest) {
    return distance > largest ? largest / distance : 1.0;
  };
  const double range_fraction = dt_s / kOutputSettings.full_range_s;
  return std::min({fraction_within(magnitude(requested.force_N - sent.force_N), slew_N_per_s * dt_s),
                   fraction_within(magnitude(requested.torque_Nmm - sent.torque_Nmm),
                                   sanitised_limit(limits.peak_torque_Nmm) * range_fraction),
                   fraction_within(std::abs(requested.gripper_N - sent.gripper_N),
                                   sanitised_limit(limits.peak_gripper_N) * range_fraction)});
}

// Sets the output to zero after a fault or a stale pose and selects how it recovers: by the slew after the
// first short dropout, by the ramp otherwise. A pause, which fades out, never waits for a fresh pose.
void drop_output(const OutputRequest& request, std::uint32_t faults, OutputState& state) {
  const bool is_short = request.age_s <= kOutputSettings.short_dropout_s &&
                        (state.in_dropout || state.since_fault_s >= kOutputSettings.ramp_in_s);
  state.in_dropout = faults == 0 && !request.fade_out && request.age_s >= kOutputSettings.stale_s && is_short;
  if (!state.in_dropout) state.gain = 0;
  state.sent = {};
  state.since_fault_s = 0;
  state.returning = false;
}

// Slew limit for this tick; reduced while the force grows after a short dropout.
double slew_now_N_per_s(const OutputLimits& limits, const Vector<World>& target_N, double dt_s,
                        OutputState& state) {
  state.returning = state.in_dropout || (state.returning && state.since_fault_s < kOutputSettings.return_s);
  state.in_dropout = false;
  state.since_fault_s = std::min(kOutputSettings.ramp_in_s, state.since_fault_s + dt_s);
  const double slew_N_per_s = limits.slew_N_per_s > 0 ? limits.slew_N_per_s : OutputLimits{}.slew_N_per_s;
  const bool grows = magnitude(target_N) > magnitude(state.sent.force_N);
  return state.returning && grows ? std::min(slew_N_per_s, kOutputSettings.return_N_per_s) : slew_N_per_s;
}

Wrench interpolate_wrench(const Wrench& from, const Wrench& to, double fraction) {
  if (fraction == 1) return to;
  return {from.force_N + (to.force_N - from.force_N) * fraction,
          from.torque_Nmm + (to.torque_Nmm - from.torque_Nmm) * fraction,
          from.gripper_N + (to.gripper_N - from.gripper_N) * fraction};
}

// force and torque keep their directions and their ratio; the gripper is clamped independently
Wrench clamp_wrench(const Wrench& w, const OutputLimits& limits, double limit_N) {
  const double factor = std::min(factor_to(limit_N, magnitude(w.force_N)),
                                 factor_to(sanitised_limit(limits.peak_torque_Nmm), magnitude(w.torque_Nmm)));
  const double grip_N = sanitised_limit(limits.peak_gripper_N);
  return {w.force_N * factor, w.torque_Nmm * factor, std::clamp(w.gripper_N, -grip_N, grip_N)};
}

// torque and gripper force that the device cannot exert are dropped first, so that they do not scale the
// force
Wrench without_unsupported(const OutputLimits& limits, Wrench w) {
  if (sanitised_limit(limits.peak_torque_Nmm) == 0) w.torque_Nmm = {};
  if (sanitised_limit(limits.peak_gripper_N) == 0) w.gripper_N = 0;
  return w;
}

}  // namespace

Output make_output(const OutputRequest& request, const OutputLimits& limits, double max_force_N, double dt_s,
                   OutputState& state) {
  dt_s = dt_s > 0 ? std::min(dt_s, kOutputSettings.max_tick_s) : 0;
  Output out;
  out.flags = request.faults & kFaultFlags;
  if (!all_finite(request.requested)) out.flags |= kFlagNotFinite;

  // a stale state fades, a fault zeroes the force at once
  const double freshness = freshness_at(request.age_s);
  if (freshness < 1) out.flags |= kFlagStale;
  if ((out.flags & kFaultFlags) != 0 || freshness == 0) {
    drop_output(request, out.flags & kFaultFlags, state);
    state.heat = next_heat(limits, state.heat, 0, dt_s);
    return out;
  }

  // force limit
  const double configured_N = configured_limit_N(limits, max_force_N);
  out.limit_N = next_limit_N(limits, max_force_N, dt_s, state);
  if (out.limit_N < configured_N) out.flags |= kFlagThermal;
  const Wrench requested = without_unsupported(limits, request.requested);
  const Wrench clamped_wrench = clamp_wrench(requested, limits, out.limit_N);
  if (magnitude(clamped_wrench.force_N) < magnitude(requested.force_N) ||
      magnitude(clamped_wrench.torque_Nmm) < magnitude(requested.torque_Nmm))
    out.flags |= kFlagClamped;

  // ramp, then slew
  state.gain = request.fade_out ? std::max(0.0, state.gain - dt_s / kOutputSettings.ramp_out_s)
                                : std::min(1.0, state.gain + dt_s / kOutputSettings.ramp_in_s);
  if (state.gain < 1) out.flags |= kFlagRamp;
  const Wrench target = scale_wrench(clamped_wrench, state.gain);
  const double fraction =
      slew_fraction(state.sent, target, limits, slew_now_N_per_s(limits, target.force_N, dt_s, state), dt_s);
  if (fraction < 1) out.flags |= kFlagSlew;

  // second clamp, because the slew may start above a limit that was just lowered; then the decay of a stale
  // state
  out.wrench = scale_wrench(
      clamp_wrench(interpolate_wrench(state.sent, target, fraction), limits, out.limit_N), freshness);
  state.heat = next_heat(limits, state.heat, magnitude(out.wrench.force_N), dt_s);
  state.sent = out.wrench;
  return out;
}

double next_limit_N(const OutputLimits& limits, double max_force_N, double dt_s, const OutputState& state) {
  return std::min(configured_limit_N(limits, max_force_N), thermal_limit_N(limits, state.heat, dt_s));
}

}  // namespace palpate
