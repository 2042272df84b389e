#pragma once

#include <string>

#include "palpate/tissue/feel.h"

/// What decides how it feels besides the scene and the parameters, all of it: the same in every run of one
/// version of palpate, and told in every recording. docs/reference/feel.md lists it.
namespace palpate {

/// The last stage before a device (docs/concepts/servo.md).
struct OutputFeel {
  /// A change of model, method or parameters is spread over this time.
  double blend_s = 0.1;
  /// From nothing to full force, at the start and after every fault; from full force to nothing, before a
  /// pause or the end.
  double ramp_in_s = 0.5, ramp_out_s = 0.1;
  /// A state of up to this age is acted on in full; one of this age gets nothing.
  double fresh_s = 5e-3, stale_s = 10e-3;
  /// A dropout: poses that have been no older than this come back faster than by the ramp.
  double short_dropout_s = 20e-3;
  /// So fast the force grows then, and no faster for so long: 0.2 N in a tick of 1 kHz is no kick. 9 N, more
  /// than any known device has, are back in 50 ms; the rest is for the hand's rebound. A hand that lost its
  /// support sinks the less the faster it comes back.
  double return_N_per_s = 195, return_s = 100e-3;
  /// For so long a damper along the force stops what the hand gained in its fall, and its rebound. It adds no
  /// more than the force itself; a device that bears less has less.
  double return_damping_N_s_per_m = 15;
  /// A state from the future comes from another clock; by so much, it is one that is set to ours.
  double clock_jitter_s = 1e-3;
  /// Time constant of the motors' warming. An assumption: the makers give a continuous force and a peak, and
  /// the windings of small ironless motors warm within some ten seconds (docs/decisions/0008).
  double thermal_s = 10;
  /// The last of the budget is spent over this time, so that the limit sinks and does not drop.
  double thermal_taper_s = 0.2;
  /// Torque and gripper may change by their whole range in this time.
  double full_swing_s = 10e-3;
  /// A tick that took longer warms and cools no more, and moves the force no farther.
  double longest_tick_s = 0.1;
  /// No hand moves a device farther than this in one tick, and none faster; mm of the device.
  double jump_mm = 10, jump_mm_s = 10e3;

  template <class Visit>
  constexpr void visit(Visit&& of) const {
    of("blend_s", blend_s);
    of("ramp_in_s", ramp_in_s);
    of("ramp_out_s", ramp_out_s);
    of("fresh_s", fresh_s);
    of("stale_s", stale_s);
    of("short_dropout_s", short_dropout_s);
    of("return_N_per_s", return_N_per_s);
    of("return_s", return_s);
    of("return_damping_N_s_per_m", return_damping_N_s_per_m);
    of("clock_jitter_s", clock_jitter_s);
    of("thermal_s", thermal_s);
    of("thermal_taper_s", thermal_taper_s);
    of("full_swing_s", full_swing_s);
    of("longest_tick_s", longest_tick_s);
    of("jump_mm", jump_mm);
    of("jump_mm_s", jump_mm_s);
  }
};

/// A turning object (docs/concepts/passivity.md, "A turning object").
struct TurningFeel {
  /// From a command to where it leads.
  double interval_s = 0.1;
  /// A turning object does no more work on a hand, and takes no more from it: 1 N leads it 1 mm in the 0.2 s
  /// that a person needs to react.
  double most_power_mW = 5;
  /// What lies under a tip to which a force is sent moves no faster, mm of the device: a surface that meets a
  /// tip comes as a slow hand would.
  double most_speed_mm_s = 100;
  /// Nor farther in a tick than makes this force of the model's stiffest tissue.
  double most_step_N = 0.1;
  /// What one tick may spend does not grow with its lateness beyond this.
  double longest_tick_s = 0.01;
  /// The turn of a tick is that small that its way is nearly straight: tries until it is within the limits.
  int tries = 6;

  template <class Visit>
  constexpr void visit(Visit&& of) const {
    of("interval_s", interval_s);
    of("most_power_mW", most_power_mW);
    of("most_speed_mm_s", most_speed_mm_s);
    of("most_step_N", most_step_N);
    of("longest_tick_s", longest_tick_s);
    of("tries", tries);
  }
};

inline constexpr OutputFeel kOutputFeel;
inline constexpr TurningFeel kTurningFeel;
static_assert(names_every_member<OutputFeel>() && names_every_member<TurningFeel>());

/// Every setting: `of(group, name, value)`, value a double or an int.
template <class Visit>
void visit_feel(Visit&& of) {
  const auto group = [&](const char* title, const auto& settings) {
    settings.visit([&](const char* name, auto value) { of(title, name, value); });
  };
  group("proxy", kProxyFeel);
  group("tool_turn", kToolTurnFeel);
  group("touch", kTouchFeel);
  group("passivity", kPassivityFeel);
  group("swing", kSwingFeel);
  group("bounce", kBounceFeel);
  group("yield", kYieldFeel);
  group("solving", kSolvingFeel);
  group("cutting", kCuttingFeel);
  group("output", kOutputFeel);
  group("turning", kTurningFeel);
}

/// All of them as a recording's header has them: a line "group.name value" each, numbers so that they come
/// back as they were.
std::string feel_text();
/// "group.name WAS, here IS" of what differs between this version and a text, the first of them; empty where
/// nothing does.
std::string first_other_feel(const std::string& text);

}  // namespace palpate
