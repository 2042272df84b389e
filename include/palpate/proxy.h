#pragma once

#include <array>
#include <bitset>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>

#include "palpate/surface.h"

/// Contact that keeps the tool out: a proxy of the tip stays on the surfaces while the tip goes inside, and
/// a spring pulls the hand towards it (Zilles & Salisbury 1995; on implicit surfaces Salisbury & Tarr 1997).
/// Positions in the patient frame, so that a proxy that sticks rides on a turning object.
namespace palpate {

/// A surface with how it feels.
struct FeltSurface {
  std::shared_ptr<const Surface> surface;
  double stiffness_N_per_mm = 1;
  double static_friction = 0.1;   ///< coefficient up to which the proxy sticks; at least dynamic_friction
  double dynamic_friction = 0.1;  ///< coefficient with which it slides
  /// Force that makes the tool go through; infinite: never.
  double puncture_N = std::numeric_limits<double>::infinity();
};
inline constexpr std::size_t kMostSurfaces = 256;
using SurfaceSet = std::bitset<kMostSurfaces>;

/// A part of the tool. A point is the smallest sphere there is.
struct ToolSphere {
  Vector<Patient> offset_mm;  ///< from the tip, as the tool is turned now
  double radius_mm = 0;
};
inline constexpr std::size_t kMostToolSpheres = 4;

/// Where a sphere of the tool leans on a surface.
struct ProxyContact {
  int surface = -1;
  int sphere = 0;
  Vector<Patient> normal;  ///< outward, unit
  double pull_mm = 0;      ///< along the normal: what it adds to the way from the tip to the proxy
};
/// A corner of three walls, each of which may be met by every sphere of the tool.
inline constexpr std::size_t kMostContacts = 3 * kMostToolSpheres;

/// What is remembered between two ticks. Small and without pointers.
struct ProxyState {
  /// False: the tip has not been free since contact began anew (start, clutch, pause, jump, a surface that
  /// has grown over it), so that nobody knows on which side it is. No force then.
  bool coupled = false;
  bool sticking = false;
  Point<Patient> position;   ///< of the tip's proxy
  Vector<Patient> last_way;  ///< its last stride, mm: the next one is not to go to and fro
  SurfaceSet punctured;      ///< the tool has gone through surface n and not come out yet
  int contacts = 0;
  std::array<ProxyContact, kMostContacts> contact;
};

struct ProxyOptions {
  bool friction = true;
  /// Stiffer surfaces are felt as this stiff: the most that a hand holds with the device.
  double most_stiffness_N_per_mm = std::numeric_limits<double>::infinity();
};

struct ProxyResult {
  Vector<Patient> force_N;        ///< on the tip
  Vector<Patient> torque_Nmm;     ///< about the tip
  double stiffness_N_per_mm = 0;  ///< of the surfaces touched, weighted by their pulls
  /// The tool is wider than the gap that it is in: no place is left by all walls, and the proxy stays. Where
  /// a turn of the tool has brought it there, without force, until the tip is free.
  bool wedged = false;
  bool ruptured = false;  ///< it went through a surface in this tick
  /// The tip moved farther than one tick's work follows; the proxy goes on in the next.
  bool lagging = false;
};

/// One tick: the proxy goes from where it was towards the tip, along surfaces and never through them. The
/// whole way is looked at, in steps that the clearance allows: at no place of it does a sphere lie deeper
/// than kMostDip_mm below a surface. Then the spring. Bounded work; allocates, locks and throws nothing. A
/// turn of the tool is not a way: spheres that it puts a little below a surface are taken back, those that it
/// puts on the other side of one are there.
///
/// - Free space is crossed in strides of the clearance (sphere tracing, Hart 1996).
/// - On surfaces the goal is the point nearest to the tip in the half-spaces of all that is touched, by
///   active set; so corners, gaps and both walls of a notch hold.
/// - Friction: the proxy sticks while its way to the goal is at most static_friction times the depth, and
///   slides to dynamic_friction times the depth (friction cone: Harwin & Melder 2002).
/// - Stiffness and friction are those of the surfaces touched, weighted by their pulls. A surface is gone
///   through when what it gives of the spring's force, friction aside and before any limit, stiffness
///   included, is above its puncture force; it closes again when tip and proxy have left it.
/// @param surfaces  at most kMostSurfaces; the same ones in every call with one state
/// @param spheres   1 ... kMostToolSpheres
/// @param tip       finite
ProxyResult advance_proxy(std::span<const FeltSurface> surfaces, std::span<const ToolSphere> spheres,
                          const Point<Patient>& tip, ProxyState& state, const ProxyOptions& options = {});
inline constexpr double kMostDip_mm = 0.05;

/// Which of the surfaces before a change one of those after it was.
struct SurfaceBefore {
  std::int16_t index;  ///< of the same structure's; -1: it had none
  bool same;           ///< in shape and place, however it feels now
};
/// After a change of the surfaces. What has not changed shape keeps the proxy as it is: where it is, what it
/// sticks to, what it has gone through. A structure that was gone through and has another shape now is still
/// gone through. A proxy that lies inside a surface that is new or has another shape is let go: nobody knows
/// on which side of that it is.
/// @param before  one for each of `surfaces`; empty where nothing is known of those before: all are new
void keep_proxy(std::span<const FeltSurface> surfaces, std::span<const ToolSphere> spheres,
                std::span<const SurfaceBefore> before, ProxyState& state);

/// Couples a tip that is inside: its proxy is born at the nearest place outside all surfaces. False where
/// there is none within their reach. The caller lets the force ramp in.
bool give_birth_to_proxy(std::span<const FeltSurface> surfaces, std::span<const ToolSphere> spheres,
                         const Point<Patient>& tip, ProxyState& state);

}  // namespace palpate
