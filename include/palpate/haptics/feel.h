#pragma once

#include <cstddef>

/// What decides how contact feels besides the scene and the parameters: the same in every run of one version
/// of palpate. Recordings tell all of it (docs/reference/feel.md); lengths are mm in the patient where
/// nothing else is said.
namespace palpate {

/// Whether `visit` of a kind of settings names all of its members.
template <class Settings>
constexpr bool names_every_member() {
  std::size_t bytes = 0;
  Settings{}.visit([&](const char*, auto value) { bytes += sizeof(value); });
  // what is left is no more than the last member's padding
  return sizeof(Settings) - bytes < alignof(Settings);
}

/// The way of the proxy along surfaces. docs/decisions/0010, 0019 and 0023 have the choices.
struct ProxyFeel {
  /// What a sphere may lie deeper than a surface at any place of its way; above dip_mm.
  double most_dip_mm = 0.05;
  /// What a stride along surfaces may end below one, before it is put back onto it.
  double dip_mm = 0.008;
  /// Nearer than this a surface is a wall: then it has a half-space, before it a clearance.
  double skin_mm = 0.05;
  /// Walls that hold the proxy together lie so near to each other.
  double beside_mm = 0.02;
  /// So little below is outside.
  double outside_mm = 1e-5;
  /// Walls whose normals are as near as this (the cosine of their angle) do the same work.
  double parallel = 0.999;
  /// A shorter way counts as standing still.
  double still_mm = 2e-5;
  /// So near to the tip the proxy is where it wants to be.
  double arrived_mm = 1e-3;
  /// How far the proxy goes along surfaces in a tick, and beyond the tip's own way.
  double most_way_mm = 3, slack_mm = 0.2;
  /// Of which so much is looked at together.
  double part_mm = 0.5;
  /// A stride that leads away from the tip by more than this part of itself is not taken: normals that are
  /// smoother than the surface ask for less. What it leads away is energy that nobody put in: a tenth kept a
  /// light grip swinging over an edge. With less than a surface rises by between voxels, the proxy lags
  /// there: 0.02 turned the force by up to 4 degrees.
  double away = 0.05;
  /// Of a tool with capsules: with more a shaft wanders off over what bends between the spheres of its row.
  double away_of_capsules = 0.02;
  /// So far from a tip that has been free for so long it does not come back to it.
  double lost_mm = 2, lost_s = 0.25;
  /// A tool that has so much clearance from the outermost layer, and a straight way of free space to where it
  /// was free before contact began, has come back out of the tissue. It is looked for each time that the tip
  /// has gone so far.
  double back_clearance_mm = 0.5, back_pitch_mm = 0.05;
  /// A tool that has gone through a surface is out of it when it has left it by so much.
  double sealed_mm = 0.2;
  /// A part of a tool finds a hole that stayed open from so far aside of where it fits, and from so far
  /// before its ends.
  double hole_play_mm = 0.5;
  /// A wall that lies across a capsule stands at most so far above its outline between two of the spheres as
  /// which it is felt, which are so far apart at least.
  double row_dip_mm = 0.01, least_pitch_mm = 0.15;
  /// A proxy that slips, off an edge or over a ridge, lets its springs go by no more than this in a second
  /// beyond what the tip's own way changes them by: 20 mN in a millisecond are not felt as a click.
  double most_slip_N_per_s = 19;
  /// Work of one tick, at most: strides, tries of each, halvings of a try, corrections that put the tool back
  /// outside, ways that are felt for where no normal shows one, and places of a way back.
  int most_strides = 48, most_tries = 4, most_halvings = 8, most_corrections = 8, most_feelings = 4,
      most_back_places = 160;
  /// No stride begins after so many looks at surfaces beyond the first gathering's, which are what strides of
  /// several spheres among many walls cost; a capsule is looked at in many places.
  int most_looks = 150, most_looks_of_capsules = 1000;

  /// A stride along surfaces. Between two ends that lie at most dip_mm below, a surface as steep as a
  /// distance can rise by half a stride.
  constexpr double stride_mm() const { return 2 * (most_dip_mm - dip_mm) - 0.004; }

  template <class Visit>
  constexpr void visit(Visit&& of) const {
    of("most_dip_mm", most_dip_mm);
    of("dip_mm", dip_mm);
    of("skin_mm", skin_mm);
    of("beside_mm", beside_mm);
    of("outside_mm", outside_mm);
    of("parallel", parallel);
    of("still_mm", still_mm);
    of("arrived_mm", arrived_mm);
    of("most_way_mm", most_way_mm);
    of("slack_mm", slack_mm);
    of("part_mm", part_mm);
    of("away", away);
    of("away_of_capsules", away_of_capsules);
    of("lost_mm", lost_mm);
    of("lost_s", lost_s);
    of("back_clearance_mm", back_clearance_mm);
    of("back_pitch_mm", back_pitch_mm);
    of("most_back_places", most_back_places);
    of("sealed_mm", sealed_mm);
    of("hole_play_mm", hole_play_mm);
    of("row_dip_mm", row_dip_mm);
    of("least_pitch_mm", least_pitch_mm);
    of("most_slip_N_per_s", most_slip_N_per_s);
    of("most_strides", most_strides);
    of("most_tries", most_tries);
    of("most_halvings", most_halvings);
    of("most_corrections", most_corrections);
    of("most_feelings", most_feelings);
    of("most_looks", most_looks);
    of("most_looks_of_capsules", most_looks_of_capsules);
  }
};

/// The turn of a tool with parts aside of its tip (docs/decisions/0019).
struct ToolTurnFeel {
  /// A step of a turn goes on beyond the clearance by an arc of so much of a stride: the push of a wall that
  /// is met at a right angle is as long as the arc.
  double arc_strides = 0.45;
  /// Surfaces are gathered for so long an arc of the sphere that goes farthest, with room for being pushed
  /// (so many times as long), and then anew: of a longer one too many would be near.
  double leg_mm = 2, room = 2.2;
  /// Work of one tick, at most: legs, steps of all, halvings of a step.
  int most_legs = 8, most_steps = 48, most_halvings = 4;
  /// No step begins after so many looks at surfaces, nor a second try of one that is not the first; of a tool
  /// with capsules, which is looked at in many places.
  int most_looks = 350, most_looks_of_capsules = 3000;

  template <class Visit>
  constexpr void visit(Visit&& of) const {
    of("arc_strides", arc_strides);
    of("leg_mm", leg_mm);
    of("room", room);
    of("most_legs", most_legs);
    of("most_steps", most_steps);
    of("most_halvings", most_halvings);
    of("most_looks", most_looks);
    of("most_looks_of_capsules", most_looks_of_capsules);
  }
};

/// What contact gives the hand and what of it is told.
struct TouchFeel {
  /// Of the direct methods: below this the halo of a smoothed structure is not called a touch.
  double least_N = 0.02;
  /// A velocity is that of the way within this time (MERL c. 1997).
  double velocity_window_s = 0.01;
  /// Viscosity is whole from this far inside.
  double whole_viscosity_mm = 1;
  /// Time constant with which the stiffness that is felt follows that of the surfaces touched.
  double seam_s = 0.015;
  /// What gives a smaller part of the force than this is not told.
  double least_share = 0.01;

  template <class Visit>
  constexpr void visit(Visit&& of) const {
    of("least_N", least_N);
    of("velocity_window_s", velocity_window_s);
    of("whole_viscosity_mm", whole_viscosity_mm);
    of("seam_s", seam_s);
    of("least_share", least_share);
  }
};

/// The passivity controller (docs/concepts/passivity.md). Steps are those of the device's encoder.
struct PassivityFeel {
  /// A way of one step tells no speed: it may be the encoder's own. One for which the tip needs longer is
  /// rest.
  double telling_steps = 1.5, longest_untold_s = 0.007;
  /// What stays covered: as much as the encoder hides (F 2 steps, methods of Hannaford & Ryu with
  /// quantisation).
  double reserve_steps = 2;
  /// Slower than a speed is told the tip still has a direction: it turns where it has gone back so far, which
  /// is less than one step and more than what a turning object adds to none.
  double turn_steps = 0.8;
  /// So much of the force is taken off at most on the way out, besides an encoder step's worth.
  double most_hysteresis = 0.5;
  /// While energy is owed a step of the encoder makes no more force than this: less than what friction a
  /// device with coarse encoders has, so that the tip does not bounce within a step, of which the encoder
  /// tells nothing.
  double owing_step_N = 0.15;
  /// An encoder without a known step counts as one that is coarse among those that are known; mm of the
  /// device.
  double coarse_step_mm = 0.06;
  /// Half of what a tick is longer counts as delay: what a shorter one's hold gives out the reserve covers,
  /// s.
  double covered_tick_s = 1e-3;
  /// More damping than this makes a firmly held tip swing by itself.
  double most_damping_N_s_per_m = 20;
  /// Nor is it more than this over the time by which its force is late, T/2 + t_d: at pi/2 m over that time
  /// a mass m swings by itself, and a Touch, the lightest known device, has 0.045 kg.
  double most_damping_times_delay_kg = 0.045;

  template <class Visit>
  constexpr void visit(Visit&& of) const {
    of("telling_steps", telling_steps);
    of("longest_untold_s", longest_untold_s);
    of("reserve_steps", reserve_steps);
    of("turn_steps", turn_steps);
    of("most_hysteresis", most_hysteresis);
    of("owing_step_N", owing_step_N);
    of("coarse_step_mm", coarse_step_mm);
    of("covered_tick_s", covered_tick_s);
    of("most_damping_N_s_per_m", most_damping_N_s_per_m);
    of("most_damping_times_delay_kg", most_damping_times_delay_kg);
  }
};

/// A hand that swings by itself (swing.h). Lengths are mm of the device, steps its encoder's.
struct SwingFeel {
  /// Half of a swing takes no longer, and is as fast in the mean.
  double longest_half_s = 0.075, least_speed_mm_s = 15;
  /// It is as long, in mm and in steps: a swing and no flicker.
  double least_mm = 0.2, least_steps = 5;
  /// So many steps back it has turned.
  double turn_steps = 2;
  /// Of the half before: less, and it dies down.
  double kept = 0.75;
  /// Out of contact for so long, and nothing is left of it.
  double forgotten_s = 0.1;
  /// What is added each time to how late the force is taken to act, most of it, and how much of it is
  /// forgotten in a second.
  double later_s = 1e-3, most_later_s = 5e-3, forget_later = 1e-4;
  /// So many halves one after the other are a swing by itself.
  int halves = 3;

  template <class Visit>
  constexpr void visit(Visit&& of) const {
    of("longest_half_s", longest_half_s);
    of("least_speed_mm_s", least_speed_mm_s);
    of("least_mm", least_mm);
    of("least_steps", least_steps);
    of("turn_steps", turn_steps);
    of("kept", kept);
    of("forgotten_s", forgotten_s);
    of("later_s", later_s);
    of("most_later_s", most_later_s);
    of("forget_later", forget_later);
    of("halves", halves);
  }
};

/// A tip that falls against something (bounce.h).
struct BounceFeel {
  /// It leaves with no more than this part of the speed with which it came.
  double most_out = 0.95;
  /// Falls that are slower, in steps of the encoder, are a hand that comes down. Three steps in 4 ms.
  double least_steps_per_s = 750;
  /// So many steps it has been held back before it shows what it weighs, and so many more it may have been:
  /// then it is lighter, and thrown out faster.
  double told_steps = 2, hidden_steps = 0.5;
  /// What is in contact longer does not bounce: a bare Premium takes 25 ms on the wall that it is
  /// recommended.
  double longest_s = 0.03;

  template <class Visit>
  constexpr void visit(Visit&& of) const {
    of("most_out", most_out);
    of("least_steps_per_s", least_steps_per_s);
    of("told_steps", told_steps);
    of("hidden_steps", hidden_steps);
    of("longest_s", longest_s);
  }
};

/// Soft tissue that yields (yield.h).
struct YieldFeel {
  /// A point would sink in without resistance: thinner tools press like a sphere of this radius.
  double least_radius_mm = 0.5;
  /// Time in which what a new solution says takes the place of what the one before said: a frame's.
  double blend_s = 1.0 / 64;
  /// Along the surface W is carried on by its slope, to no less and no more than these parts of it.
  double least_carried = 0.5, most_carried = 2;
  /// Nothing is stiffer than 1 N / mm over this, whatever a solution says.
  double least_give_mm_per_N = 0.01;
  /// What a neo-Hookean solution makes stiffer or softer at its force is no more than this part of W.
  double most_stiffening = 0.2;
  /// A dent that is left in tissue that relaxes reaches so many of the tool's radii from where it was
  /// pressed.
  double dent_radii = 2;

  template <class Visit>
  constexpr void visit(Visit&& of) const {
    of("least_radius_mm", least_radius_mm);
    of("blend_s", blend_s);
    of("least_carried", least_carried);
    of("most_carried", most_carried);
    of("least_give_mm_per_N", least_give_mm_per_N);
    of("most_stiffening", most_stiffening);
    of("dent_radii", dent_radii);
  }
};

inline constexpr ProxyFeel kProxyFeel;
inline constexpr ToolTurnFeel kToolTurnFeel;
inline constexpr TouchFeel kTouchFeel;
inline constexpr PassivityFeel kPassivityFeel;
inline constexpr SwingFeel kSwingFeel;
inline constexpr BounceFeel kBounceFeel;
inline constexpr YieldFeel kYieldFeel;

static_assert(names_every_member<ProxyFeel>() && names_every_member<ToolTurnFeel>() &&
              names_every_member<TouchFeel>() && names_every_member<PassivityFeel>() &&
              names_every_member<SwingFeel>() && names_every_member<BounceFeel>() &&
              names_every_member<YieldFeel>());

}  // namespace palpate
