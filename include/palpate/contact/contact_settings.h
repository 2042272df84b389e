#pragma once

#include <cstddef>

/// Constants that determine the rendered contact besides the scene and the parameters; fixed for one version
/// of palpate. Recordings contain all of them (docs/reference/feel.md). Lengths are mm in the patient unless
/// stated otherwise.
namespace palpate {

/// Whether Settings::visit() visits every member, checked by comparing the total size of the visited values
/// with sizeof(Settings).
template <class Settings>
constexpr bool names_every_member() {
  std::size_t bytes = 0;
  Settings{}.visit([&](const char*, auto value) { bytes += sizeof(value); });
  // the remainder may only be trailing padding
  return sizeof(Settings) - bytes < alignof(Settings);
}

/// Proxy updates along surfaces. The choices are explained in docs/decisions/0010 and in
/// docs/decisions/archive/0019 and 0023.
struct ProxySettings {
  /// Maximum penetration of a sphere at any point of the proxy's path; greater than substep_penetration_mm.
  double max_penetration_mm = 0.05;
  /// Maximum penetration at the end of a substep, before the projection back onto the surface.
  double substep_penetration_mm = 0.008;
  /// Distance below which a surface becomes a half-space constraint; above it only its clearance limits the
  /// substep.
  double skin_mm = 0.05;
  /// Clearance below which a further parallel constraint shares the load of an active one.
  double load_sharing_mm = 0.02;
  /// Depth tolerance: a point less than this far below a surface still counts as outside.
  double outside_mm = 1e-5;
  /// Cosine of the angle between normals above which two constraints count as parallel.
  double min_parallel_cosine = 0.999;
  /// Displacement below which the proxy counts as at rest.
  double at_rest_mm = 2e-5;
  /// Distance from the tip below which the proxy counts as having arrived.
  double arrived_mm = 1e-3;
  /// Maximum path length of a proxy in contact per tick, and path length allowed beyond the distance to the
  /// tip.
  double max_path_mm = 3, slack_mm = 0.2;
  /// Path length of a proxy in contact for which surfaces are gathered at once.
  double gathering_mm = 0.5;
  /// Maximum fraction of a substep by which the distance to the tip may increase; needed because the normals
  /// are smoother than the surface. Every increase adds energy: at 0.1 a light grip kept oscillating over an
  /// edge. Too small a value makes the proxy lag where the surface rises between voxels: at 0.02 the force
  /// direction was off by up to 4 degrees.
  double max_distance_increase = 0.05;
  /// max_distance_increase for tools with capsules: with a larger value a shaft drifts over surfaces that
  /// curve between the spheres of its row.
  double max_distance_increase_of_capsules = 0.02;
  /// A proxy without contact farther than lost_mm from a tip in free space is reset to it after lost_s.
  double lost_mm = 2, lost_s = 0.25;
  /// Conditions for withdrawal from the tissue: clearance from the outermost layer, in addition to a
  /// collision-free straight path to the last free pose; and tip displacement after which the test is
  /// repeated.
  double withdrawal_clearance_mm = 0.5, withdrawal_pitch_mm = 0.05;
  /// Distance from a punctured surface at which the tool counts as having left it, so that it closes.
  double closing_mm = 0.2;
  /// Tolerance of a permanent hole: lateral play beyond its radius, and axial play beyond its ends.
  double hole_play_mm = 0.5;
  /// Row of spheres that represents a capsule: maximum distance of the row's outline inside the capsule's,
  /// and minimum spacing of the spheres.
  double max_row_gap_mm = 0.01, min_row_pitch_mm = 0.15;
  /// Limit of the rate at which slip (off an edge or over a ridge) changes the spring force beyond the change
  /// caused by the tip's displacement: changes of up to 20 mN per millisecond are not perceived as a click
  /// (docs/decisions/0033).
  double max_slip_N_per_s = 19;
  /// Work limits per tick: substeps, attempts per substep, halvings per attempt, projection steps back
  /// outside, searches for a direction where no normal gives one, and samples of the return path.
  int max_substeps = 48, max_attempts = 4, max_halvings = 8, max_corrections = 8, max_direction_searches = 4,
      max_withdrawal_samples = 160;
  /// No substep starts after this number of surface queries beyond those of the first gathering; queries
  /// dominate the cost of tools with several spheres among many constraints. Capsules need more queries.
  int max_queries = 150, max_queries_of_capsules = 1000;

  /// Direction search of a proxy that is blocked without a contact (blocked_proxy.h): number of cones around
  /// the direction to the tip, of which the first is that direction itself; directions per cone; angle
  /// between successive cones; and divisor of a substep that gives the shortest substep tried.
  int search_cones = 4, search_directions = 8;
  double search_cone_rad = 0.47, search_shortest_divisor = 5;
  /// Search for the nearest point outside all surfaces when contact begins inside tissue: reach, which is
  /// more than that of any distance field; projection steps per search; and number of searches, because
  /// surfaces beyond the reach of the first may be nearer at its result.
  double initial_reach_mm = 1000;
  int max_initial_steps = 64, max_initial_searches = 4;

  /// Maximum length of a substep in contact. If both ends of a substep are at most substep_penetration_mm
  /// deep and the distance field has unit slope, the penetration between them exceeds that by at most half of
  /// the substep's length. 0.004 mm is a safety margin.
  constexpr double substep_mm() const { return 2 * (max_penetration_mm - substep_penetration_mm) - 0.004; }

  template <class Visit>
  constexpr void visit(Visit&& visitor) const {
    visitor("max_penetration_mm", max_penetration_mm);
    visitor("substep_penetration_mm", substep_penetration_mm);
    visitor("skin_mm", skin_mm);
    visitor("load_sharing_mm", load_sharing_mm);
    visitor("outside_mm", outside_mm);
    visitor("min_parallel_cosine", min_parallel_cosine);
    visitor("at_rest_mm", at_rest_mm);
    visitor("arrived_mm", arrived_mm);
    visitor("max_path_mm", max_path_mm);
    visitor("slack_mm", slack_mm);
    visitor("gathering_mm", gathering_mm);
    visitor("max_distance_increase", max_distance_increase);
    visitor("max_distance_increase_of_capsules", max_distance_increase_of_capsules);
    visitor("lost_mm", lost_mm);
    visitor("lost_s", lost_s);
    visitor("withdrawal_clearance_mm", withdrawal_clearance_mm);
    visitor("withdrawal_pitch_mm", withdrawal_pitch_mm);
    visitor("max_withdrawal_samples", max_withdrawal_samples);
    visitor("closing_mm", closing_mm);
    visitor("hole_play_mm", hole_play_mm);
    visitor("max_row_gap_mm", max_row_gap_mm);
    visitor("min_row_pitch_mm", min_row_pitch_mm);
    visitor("max_slip_N_per_s", max_slip_N_per_s);
    visitor("max_substeps", max_substeps);
    visitor("max_attempts", max_attempts);
    visitor("max_halvings", max_halvings);
    visitor("max_corrections", max_corrections);
    visitor("max_direction_searches", max_direction_searches);
    visitor("max_queries", max_queries);
    visitor("max_queries_of_capsules", max_queries_of_capsules);
    visitor("search_cones", search_cones);
    visitor("search_directions", search_directions);
    visitor("search_cone_rad", search_cone_rad);
    visitor("search_shortest_divisor", search_shortest_divisor);
    visitor("initial_reach_mm", initial_reach_mm);
    visitor("max_initial_steps", max_initial_steps);
    visitor("max_initial_searches", max_initial_searches);
  }
};

/// Rotation of a tool with parts away from its tip (docs/decisions/archive/0019).
struct ToolRotationSettings {
  /// Arc that a rotation step advances beyond the clearance, as a fraction of a substep; a surface hit at a
  /// right angle pushes the tool out by the same length.
  double arc_substeps = 0.45;
  /// Leg of a rotation: arc length (of the farthest sphere) for which surfaces are gathered at once, and
  /// gathering reach as a multiple of it, which leaves a margin for the pushes. A longer leg would gather too
  /// many surfaces.
  double leg_mm = 2, gathering_legs = 2.2;
  /// Work limits per tick: legs, steps of all legs, halvings per step.
  int max_legs = 8, max_steps = 48, max_halvings = 4;
  /// Number of surface queries after which no further step starts and no step but the tick's first is
  /// retried. Tools with capsules need more queries.
  int max_queries = 350, max_queries_of_capsules = 3000;

  template <class Visit>
  constexpr void visit(Visit&& visitor) const {
    visitor("arc_substeps", arc_substeps);
    visitor("leg_mm", leg_mm);
    visitor("gathering_legs", gathering_legs);
    visitor("max_legs", max_legs);
    visitor("max_steps", max_steps);
    visitor("max_halvings", max_halvings);
    visitor("max_queries", max_queries);
    visitor("max_queries_of_capsules", max_queries_of_capsules);
  }
};

/// Rendering and reporting of contact.
struct ContactSettings {
  /// Direct methods: force below which a point in the fringe of a smoothed structure does not count as
  /// contact.
  double min_N = 0.02;
  /// Averaging window of velocities (MERL c. 1997).
  double velocity_window_s = 0.01;
  /// Depth from which viscosity is fully applied.
  double full_viscosity_mm = 1;
  /// Time constant of the low-pass filter of the rendered stiffness.
  double stiffness_filter_s = 0.015;
  /// Fraction of the force below which a structure is not reported.
  double min_fraction = 0.01;

  template <class Visit>
  constexpr void visit(Visit&& visitor) const {
    visitor("min_N", min_N);
    visitor("velocity_window_s", velocity_window_s);
    visitor("full_viscosity_mm", full_viscosity_mm);
    visitor("stiffness_filter_s", stiffness_filter_s);
    visitor("min_share", min_fraction);
  }
};

/// Passivity controller (docs/concepts/passivity.md). Steps are encoder steps of the device.
struct PassivitySettings {
  /// Minimum displacement for a velocity estimate, because a single step may be encoder flicker; and the time
  /// after which a tip without such a displacement counts as at rest.
  double min_velocity_steps = 1.5, at_rest_s = 0.007;
  /// Energy reserve: the energy must cover the force times this number of encoder steps, to account for
  /// quantisation (Hannaford & Ryu 2002).
  double reserve_steps = 2;
  /// Hysteresis of the direction of a tip too slow for a velocity estimate: displacement after which it
  /// counts as reversed. Less than one step, and more than the displacement that the rotating object adds
  /// while the encoder does not change.
  double reversal_steps = 0.8;
  /// Maximum fraction of the force that is removed during withdrawal. The removed force is also limited to
  /// that of one encoder step.
  double max_hysteresis = 0.5;
  /// Maximum force change per encoder step while the energy is negative. It is below the friction of devices
  /// with coarse encoders, so that the tip does not bounce within a single step, which the encoder cannot
  /// detect.
  double max_deficit_step_N = 0.15;
  /// Encoder step assumed if the device's is unknown: that of a coarse one among known devices; mm of the
  /// device.
  double default_step_mm = 0.06;
  /// Tick length beyond which half of the excess counts as delay; s. For shorter ticks the reserve covers the
  /// energy of the zero-order hold.
  double covered_tick_s = 1e-3;
  /// Maximum damping; more makes a firmly held tip oscillate.
  double max_damping_N_s_per_m = 20;
  /// Maximum product of the damping and the delay of its force, T/2 + t_d. A mass m becomes unstable at a
  /// product of pi/2 m; the lightest known device, the Touch, has 0.045 kg.
  double max_damping_times_delay_kg = 0.045;

  template <class Visit>
  constexpr void visit(Visit&& visitor) const {
    visitor("min_velocity_steps", min_velocity_steps);
    visitor("at_rest_s", at_rest_s);
    visitor("reserve_steps", reserve_steps);
    visitor("reversal_steps", reversal_steps);
    visitor("max_hysteresis", max_hysteresis);
    visitor("max_deficit_step_N", max_deficit_step_N);
    visitor("default_step_mm", default_step_mm);
    visitor("covered_tick_s", covered_tick_s);
    visitor("max_damping_N_s_per_m", max_damping_N_s_per_m);
    visitor("max_damping_times_delay_kg", max_damping_times_delay_kg);
  }
};

/// Detection of a self-sustained oscillation of the operator's hand (oscillation.h). Lengths are mm of the
/// device, steps those of its encoder.
struct OscillationSettings {
  /// Maximum duration of a half cycle, and its minimum mean speed.
  double max_half_cycle_s = 0.075, min_speed_mm_s = 15;
  /// Minimum amplitude of a half cycle in mm and in steps, above encoder flicker.
  double min_amplitude_mm = 0.2, min_amplitude_steps = 5;
  /// Displacement back from the extremum, in steps, after which the motion counts as reversed.
  double reversal_steps = 2;
  /// Minimum ratio to the amplitude of the previous half cycle; below it the oscillation decays.
  double min_amplitude_ratio = 0.75;
  /// Time out of contact after which the detection is reset.
  double reset_s = 0.1;
  /// Increase of the assumed force delay per detected half cycle, its maximum, and its decrease per second.
  double delay_increment_s = 1e-3, max_extra_delay_s = 5e-3, extra_delay_decay = 1e-4;
  /// Number of consecutive half cycles that count as a self-sustained oscillation.
  int min_half_cycles = 3;

  template <class Visit>
  constexpr void visit(Visit&& visitor) const {
    visitor("max_half_cycle_s", max_half_cycle_s);
    visitor("min_speed_mm_s", min_speed_mm_s);
    visitor("min_amplitude_mm", min_amplitude_mm);
    visitor("min_amplitude_steps", min_amplitude_steps);
    visitor("reversal_steps", reversal_steps);
    visitor("min_amplitude_ratio", min_amplitude_ratio);
    visitor("reset_s", reset_s);
    visitor("delay_increment_s", delay_increment_s);
    visitor("max_extra_delay_s", max_extra_delay_s);
    visitor("extra_delay_decay", extra_delay_decay);
    visitor("min_half_cycles", min_half_cycles);
  }
};

/// Impact of a falling tip (rebound.h).
struct ReboundSettings {
  /// Maximum ratio of the rebound speed to the impact speed.
  double max_restitution = 0.95;
  /// Minimum impact speed in encoder steps per second; slower contacts are deliberate. 750 steps per second
  /// are three steps in 4 ms.
  double min_steps_per_s = 750;
  /// Encoder steps of deceleration needed before the apparent mass is estimated, and steps added to account
  /// for quantisation, which makes the estimated mass lighter and the predicted rebound faster.
  double min_deceleration_steps = 2, quantisation_steps = 0.5;
  /// Duration of contact after which a rebound is excluded: a bare Premium takes 25 ms on a surface of its
  /// recommended stiffness.
  double max_contact_s = 0.03;

  template <class Visit>
  constexpr void visit(Visit&& visitor) const {
    visitor("max_restitution", max_restitution);
    visitor("min_steps_per_s", min_steps_per_s);
    visitor("min_deceleration_steps", min_deceleration_steps);
    visitor("quantisation_steps", quantisation_steps);
    visitor("max_contact_s", max_contact_s);
  }
};

/// Deformable soft tissue (soft_contact.h).
struct SoftTissueSettings {
  /// Minimum radius of the pressing sphere; a point would sink in without resistance.
  double min_radius_mm = 0.5;
  /// Blending time between two published elastic solutions: one solver frame.
  double blend_s = 1.0 / 64;
  /// Limits of the extrapolation of the compliance W along the surface by its slope, as fractions of W.
  double min_extrapolation = 0.5, max_extrapolation = 2;
  /// Lower limit of the compliance of any solution; 1 N over it is the maximum stiffness.
  double min_compliance_mm_per_N = 0.01;
  /// Limit of the stiffening or softening of a neo-Hookean solution at its force, as a fraction of W.
  double max_stiffening = 0.2;
  /// Factor k of the contact's stiffening by the exponent of the tissue (strain_stiffening.h).
  double stiffening_factor = 0.183;
  /// Radius of the dent that is left in relaxing tissue, in radii of the tool that pressed it.
  double dent_radii = 2;

  template <class Visit>
  constexpr void visit(Visit&& visitor) const {
    visitor("min_radius_mm", min_radius_mm);
    visitor("blend_s", blend_s);
    visitor("min_extrapolation", min_extrapolation);
    visitor("max_extrapolation", max_extrapolation);
    visitor("min_compliance_mm_per_N", min_compliance_mm_per_N);
    visitor("max_stiffening", max_stiffening);
    visitor("stiffening_factor", stiffening_factor);
    visitor("dent_radii", dent_radii);
  }
};

inline constexpr ProxySettings kProxySettings;
inline constexpr ToolRotationSettings kToolRotationSettings;
inline constexpr ContactSettings kContactSettings;
inline constexpr PassivitySettings kPassivitySettings;
inline constexpr OscillationSettings kOscillationSettings;
inline constexpr ReboundSettings kReboundSettings;
inline constexpr SoftTissueSettings kSoftTissueSettings;

static_assert(names_every_member<ProxySettings>() && names_every_member<ToolRotationSettings>() &&
              names_every_member<ContactSettings>() && names_every_member<PassivitySettings>() &&
              names_every_member<OscillationSettings>() && names_every_member<ReboundSettings>() &&
              names_every_member<SoftTissueSettings>());

}  // namespace palpate
