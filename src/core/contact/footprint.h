#pragma once

#include <cstddef>
#include <span>

#include "palpate/contact/proxy.h"

/// Contact area of a tool with several parts, or of a capsule that lies along soft tissue, reduced to one
/// equivalent Hertz sphere.
namespace palpate {

/// Sphere of the tool, or of a capsule's row, that penetrates the undeformed surface.
struct FootprintPoint {
  Vector<Patient> centre_mm;  ///< Centre relative to the tip
  double radius_mm = 0;       ///< Radius; above 0
  double depth_mm = 0;        ///< Penetration of the undeformed surface; above 0
};
inline constexpr std::size_t kMaxFootprintPoints = 24;

/// Sphere that is equivalent to several press points under the contact law of a tick (soft_contact.h).
struct Footprint {
  double depth_mm = 0, radius_mm = 0;
  /// Additional compliance from the interaction of the press points, times E*: pressure at one lowers the
  /// surface at another by 1 / (pi E* r) per unit force at a distance r (Boussinesq), and by less on a layer.
  double interaction_per_mm = 0;
  /// Ratio of dF/dd of all press points displaced together to that of the equivalent sphere; at least 1.
  double stiffness_ratio = 1;
  /// Force-weighted mean of the vectors from the tip to the points of action on the surface.
  Vector<Patient> arm_mm;
};

/// Equivalent sphere of several press points. Points far apart follow Hertz's law independently, f ~ sqrt(R)
/// d^1.5. A sphere with the force-weighted mean depth, and with the radius that gives the sum of the forces,
/// then has the exact force and energy. A point behind a deeper one along the pressing direction is shielded:
/// if their lateral distance is less than the smaller radius, its weight is the ratio of the two. The result
/// is continuous when a point enters the surface or passes another one. Bounded work; does not allocate, lock
/// or throw.
/// @param points       1 ... kMaxFootprintPoints
/// @param along        direction in which the tissue pushes the tool back; unit
/// @param base_per_mm  -B E* of tissue on a rigid base (layer_base_mm_per_N); 0: a half-space, or softer.
///                     Press points farther apart than the layer is thick do not lower each other, and each
///                     is supported by the base under its own force only
Footprint footprint_of(std::span<const FootprintPoint> points, const Vector<Patient>& along,
                       double base_per_mm = 0);

/// Mutual compliance of two press points (displacement at one per unit force at the other), times E*, plus
/// `base_per_mm`, because the sphere law subtracts the base's contribution for the sum of all forces:
/// 1 / (pi r) (1 - x)^2 with x = pi base r / 2, and 0 from x = 1 on. Press points closer than a radius are
/// partly merged.
/// @param lateral_mm   lateral distance r
/// @param radius_mm    the smaller radius; above 0
/// @param base_per_mm  as for footprint_of
double pair_interaction_per_mm(double lateral_mm, double radius_mm, double base_per_mm);

/// Press points of a tool: one per sphere; for a capsule a row whose spacing is at least its radius. Depths
/// are the maximum over the given surfaces.
/// @param surfaces  all surfaces of the model
/// @param touched   indices of the surfaces in contact, without duplicates
/// @param parts   tool parts
/// @param tip       position of the tip
/// @param points    receives the press points, in the order of the tool's parts
/// @returns number of press points written
std::size_t find_press_points(std::span<const ContactSurface> surfaces, std::span<const int> touched,
                              std::span<const ToolPart> parts, const Point<Patient>& tip,
                              std::span<FootprintPoint> points);

}  // namespace palpate
