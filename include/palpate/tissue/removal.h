#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "palpate/haptics/proxy.h"
#include "palpate/tissue/carving.h"

/// A burr that takes bone away, felt in the tick in which it does. Positions in the patient frame.
namespace palpate {

/// A head that turns: a ball, or a row of balls along the spindle that is a cylinder or a cone with round
/// ends (Sweep). The first ball's middle is at the tip.
struct Burr {
  double radius_mm = 1.5;  ///< of the first ball; of a ball half of what its maker calls its size
  double revolutions_per_s = 0;
  /// Of the spindle, unit, as the tool is turned now. What lies on it moves slowly and cuts little.
  Vector<Patient> axis = {0, 0, 1};
  /// Of the cutting edges' force the part that is along their way, to the part that presses (a coefficient of
  /// friction).
  double grip = 0.5;
  /// It is pressed with no more, however far the hand is from the proxy: what the device gives at most.
  double most_press_N = std::numeric_limits<double>::infinity();
  /// It is held out of those that are kept.
  std::span<const ProtectedStructure> spared = {};
  std::uint32_t stroke = 0;  ///< of what it sweeps
  double length_mm = 0;      ///< from the first ball's middle to the last one's, along `axis`; 0: a ball
  double end_radius_mm = 0;  ///< of the last ball, above 0; of a ball without meaning

  /// As a part of the tool whose radii are all less by so much, as the hand turns it.
  ToolSphere head(double inset_mm) const;
  double thinnest_mm() const;
  double widest_mm() const;
};

/// Sweeps that are not carved, at most.
inline constexpr int kMostSweeps = 64;

/// What it has done that is not in the surfaces yet, and what is remembered between two ticks. Without
/// pointers.
struct BurrState {
  /// So much less than its radii it is held out by: as deep as it has sunk in since the surfaces were made.
  double inset_mm = 0;
  double sunk_mm = 0;             ///< how deep it lies in the surfaces, of that
  double spare_mJ = 0;            ///< that the motor has worked and the burr has not used yet
  double pressed_N = 0;           ///< by the hand in the last tick
  double edge_mm_per_s = 0;       ///< mean speed of the edges in the material, then
  double front_mm2 = 0;           ///< area of the material ahead, seen along the way it is pressed
  double energy_mJ_per_mm3 = 0;   ///< of the material there
  double work_mJ = 0;             ///< of the motor, since the start
  double taken_mm3 = 0;           ///< since the start, as the law reckons it
  int layer = -1;                 ///< of the proxy's, in which it cuts; -1: none
  bool closed = false;            ///< the last sweep grows no more, as that of a burr that stands still
  Vector<Patient> began_axis_mm;  ///< of the last sweep: how the head was turned when that began
  double open_s = 0;              ///< since it began
  bool full = false;              ///< no room for what it sweeps: it cuts nothing until the surfaces are made
  std::uint64_t first = 0;        ///< number of the first of the sweeps here, counted from the start
  int sweeps = 0;
  std::array<Sweep, kMostSweeps> sweep;

  std::span<const Sweep> pending() const { return {sweep.data(), static_cast<std::size_t>(sweeps)}; }
};

/// One tick of a burr: it takes away, then the proxy advances to where it may be now, with the burr for its
/// tool.
///
///     power        P = grip * force * speed of the edges              (Arbabtafti et al. 2011: the energy
///     rate         volume per s = P / energy                           per volume is the material's own)
///     feed         rate / area of the material ahead, along the way the hand presses
///
/// A burr that sinks in by the feed is held out by that much less than its radii, until surfaces are made
/// without what it took (CarvedSurface). It takes with it whatever it sweeps, and comes no farther through
/// material than the motor has worked for, whichever way it goes or turns. So the volume follows from work
/// alone, at any rate of ticks, and new surfaces, which are read from between voxels, move it no faster than
/// it cuts.
///
/// The area and the speed are means over directions ahead in which there is material right before the burr;
/// of a cylinder or cone over its round ends and its side. Where it turns, the area is that which sweeps the
/// same volume if all of it went as far as the end that goes farthest. Without revolutions it is a tool that
/// cuts nothing. In the innermost layer that is touched; what yields around that is pushed aside.
///
/// No layer's proxy brings any part of the head, with its whole radius, deeper into a structure that is kept
/// than the head was: it slides along that structure's own surface as prepared. Of the material ahead a kept
/// structure is none. Bounded work; allocates, locks and throws nothing.
/// @param hand  the attitude by which `burr.axis` is turned
ProxyResult advance_burr(std::span<const FeltSurface> surfaces, const Burr& burr, const ToolPose& hand,
                         ProxyState& proxy, BurrState& state, const ProxyOptions& options = {});

/// The surfaces are now those without the first so many of the sweeps, counted from the start. To be called
/// before keep_proxy. Where an undo has put material back around the burr, the overlap counts as depth
/// that it has sunk in, so that the force does not jump. Where that is as much as its least radius, as where
/// a ball's middle is in the material, the proxy is dropped (by keep_proxy) and the force fades out.
/// @param hand  the attitude by which `burr.axis` is turned
void settle_burr(std::span<const FeltSurface> surfaces, const Burr& burr, const ToolPose& hand,
                 std::uint64_t carved, const ProxyState& proxy, BurrState& state);

/// How many sweeps there are that grow no more, counted from the start: those that a surface can be carved
/// by.
std::uint64_t finished_sweeps(const BurrState& state);
/// The finished ones from a number on, which is not below the first that is still here.
std::span<const Sweep> finished_from(const BurrState& state, std::uint64_t number);
/// All of them that are still here, as a session cuts by them.
std::vector<Cut> finished_cuts(const BurrState& state, std::uint32_t device);

}  // namespace palpate
