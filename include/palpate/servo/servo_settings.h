#pragma once

#include "palpate/contact/contact_settings.h"

/// Constants of the output stage, of a turning object and of the rendering of a burr. They are fixed for one
/// version of palpate; docs/reference/feel.md lists them.
namespace palpate {

/// Constants of the output stage, the last step before a device (docs/concepts/servo.md).
struct OutputSettings {
  /// Duration over which a change of model, method or parameters is blended in.
  double blend_s = 0.1;
  /// Duration of the ramp from zero to full force, at the start and after every fault, and of the ramp from
  /// full force to zero, before a pause or the end.
  double ramp_in_s = 0.5, ramp_out_s = 0.1;
  /// Pose age up to which the force is passed in full, and age from which it is zero; linear in between.
  double fresh_s = 5e-3, stale_s = 10e-3;
  /// Dropouts in which the pose gets no older than this recover by the slow slew below instead of the ramp.
  double short_dropout_s = 20e-3;
  /// Growth rate of the force after a short dropout, and the time for which it is limited to that rate. 195
  /// N/s is 0.2 N per 1 kHz tick, which is not perceived as a kick. At this rate 9 N, more than any known
  /// device exerts, are restored within 50 ms; the remaining time covers the rebound of the operator's hand.
  /// With a lower rate a supported hand would sink deeper.
  double return_N_per_s = 195, return_s = 100e-3;
  /// Damping along the force for the same time, which stops the velocity gained during the dropout and the
  /// rebound. It adds at most the force itself. Devices that bear less damping get less.
  double return_damping_N_s_per_m = 15;
  /// Tolerance for sample times in the future: up to this much is attributed to adjustment of the same clock,
  /// more to a different clock.
  double clock_jitter_s = 1e-3;
  /// Time constant of the motors' heating. An assumption: vendors state a continuous and a peak force, and
  /// the windings of small ironless motors warm within some ten seconds (docs/decisions/0008).
  double thermal_s = 10;
  /// Time over which the rest of the thermal budget may be spent, so that the limit falls gradually.
  double thermal_taper_s = 0.2;
  /// Time in which torque and gripper force may change by their whole range.
  double full_range_s = 10e-3;
  /// Upper bound of the tick duration used for heating, cooling and slew.
  double max_tick_s = 0.1;
  /// Largest plausible displacement in one tick and largest plausible speed of a device, device mm; a motion
  /// that exceeds both is a jump (a fault).
  double jump_mm = 10, jump_mm_s = 10e3;

  template <class Visit>
  constexpr void visit(Visit&& visitor) const {
    visitor("blend_s", blend_s);
    visitor("ramp_in_s", ramp_in_s);
    visitor("ramp_out_s", ramp_out_s);
    visitor("fresh_s", fresh_s);
    visitor("stale_s", stale_s);
    visitor("short_dropout_s", short_dropout_s);
    visitor("return_N_per_s", return_N_per_s);
    visitor("return_s", return_s);
    visitor("return_damping_N_s_per_m", return_damping_N_s_per_m);
    visitor("clock_jitter_s", clock_jitter_s);
    visitor("thermal_s", thermal_s);
    visitor("thermal_taper_s", thermal_taper_s);
    visitor("full_range_s", full_range_s);
    visitor("max_tick_s", max_tick_s);
    visitor("jump_mm", jump_mm);
    visitor("jump_mm_s", jump_mm_s);
  }
};

/// Limits on a turning object (docs/concepts/passivity.md, "A turning object").
struct RotationSettings {
  /// Duration of the interpolation from a rotation command to its target.
  double interval_s = 0.1;
  /// Limit of the power that a turning object exchanges with an operator, in either direction: within the 0.2
  /// s that a person needs to react, 1 N displaces the hand by 1 mm.
  double max_power_mW = 5;
  /// Limit of the speed of the material point under a tip to which a force is sent, device mm/s: a rotating
  /// surface approaches a tip no faster than a slow hand motion.
  double max_speed_mm_s = 100;
  /// Limit of that point's displacement per tick, given as the force that it causes at the model's stiffest
  /// tissue.
  double max_step_N = 0.1;
  /// Upper bound of the tick duration that counts towards the limits, so that a late tick gets no larger
  /// budget.
  double max_tick_s = 0.01;
  /// Maximum number of iterations that shorten a tick's rotation until it is within the limits. The rotation
  /// of one tick is small enough for the path of the point to be nearly straight, so that few iterations
  /// suffice.
  int max_iterations = 6;

  template <class Visit>
  constexpr void visit(Visit&& visitor) const {
    visitor("interval_s", interval_s);
    visitor("max_power_mW", max_power_mW);
    visitor("max_speed_mm_s", max_speed_mm_s);
    visitor("max_step_N", max_step_N);
    visitor("max_tick_s", max_tick_s);
    visitor("max_iterations", max_iterations);
  }
};

/// Vibration, kick, break-through and heating of a burr (docs/decisions/0091-vibration-of-a-burr.md).
struct BurrRenderingSettings {
  /// Upper end of the band in which vibration is rendered: the hand is most sensitive around 200 Hz, and a
  /// tick of 1 ms renders a period in five steps.
  double max_hz = 200;
  /// Upper end of the band in periods per tick; determines the band for longer ticks.
  double max_cycles_per_tick = 0.25;
  /// Run-out of the cutting edges, an assumption.
  double runout_mm = 1e-3;
  /// Largest amplitude of the vibration and largest force of a kick, at the device.
  double max_vibration_N = 0.15, max_kick_N = 0.3;
  /// Time constant of the mean press force: a kick follows changes that are faster.
  double kick_s = 0.03;
  /// Minimum sine of the angle between spindle and contact normal at which the direction of the cutting edges
  /// is defined.
  double min_sine = 0.05;
  /// Minimum press force, in the patient, for a break-through to be reported.
  double min_press_N = 0.02;
  /// Free distance ahead of the head's foremost point that counts as a break-through, and the spacing at
  /// which it is sampled, from CuttingSettings::lookahead_mm on.
  double free_mm = 0.5, free_step_mm = 0.2;
  /// Time for which a break-through is reported, so that viewers with 10 poses per second notice it.
  double break_through_s = 0.1;
  /// Bone: thermal conductivity, heat capacity by volume, and the fraction of the motor's work that heats the
  /// bone rather than chips, tool and air (an assumption).
  double conductivity_W_per_m_K = 0.54, capacity_mJ_per_mm3_K = 2.5, heat_fraction = 0.1;

  template <class Visit>
  constexpr void visit(Visit&& visitor) const {
    visitor("max_hz", max_hz);
    visitor("max_cycles_per_tick", max_cycles_per_tick);
    visitor("runout_mm", runout_mm);
    visitor("max_vibration_N", max_vibration_N);
    visitor("max_kick_N", max_kick_N);
    visitor("kick_s", kick_s);
    visitor("min_sine", min_sine);
    visitor("min_press_N", min_press_N);
    visitor("free_mm", free_mm);
    visitor("free_step_mm", free_step_mm);
    visitor("break_through_s", break_through_s);
    visitor("conductivity_W_per_m_K", conductivity_W_per_m_K);
    visitor("capacity_mJ_per_mm3_K", capacity_mJ_per_mm3_K);
    visitor("heat_fraction", heat_fraction);
  }
};

inline constexpr OutputSettings kOutputSettings;
inline constexpr RotationSettings kRotationSettings;
inline constexpr BurrRenderingSettings kBurrRenderingSettings;
static_assert(names_every_member<OutputSettings>() && names_every_member<RotationSettings>() &&
              names_every_member<BurrRenderingSettings>());

}  // namespace palpate
