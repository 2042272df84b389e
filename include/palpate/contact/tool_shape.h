#pragma once

#include <array>
#include <cstddef>
#include <limits>
#include <span>

#include "palpate/sampling/surface.h"

/// Shape and pose of a tool: spheres and capsules that make contact, in the patient frame.
namespace palpate {

/// A collision primitive of the tool: a sphere, or a capsule (a sphere swept along a segment) whose radius
/// may change linearly along its axis. A point tool is a sphere of radius 0.
struct ToolPart {
  Vector<Patient> offset_mm;  ///< Centre relative to the tip, in the tool's current attitude
  double radius_mm = 0;
  /// Axis of a capsule, from the end at offset_mm to the other end; mm. 0: a sphere.
  Vector<Patient> axis_mm = {};
  /// Radius at the other end of a capsule minus radius_mm; negative where it tapers. If not 0, both radii are
  /// above 0.
  double radius_change_mm = 0;
  /// Radius from which the spacing of a capsule's row of spheres is computed; 0: the capsule's own radius. A
  /// fixed value keeps the spheres at the same axis positions when the radius changes.
  double row_radius_mm = 0;

  /// @param axis_fraction  position on the axis, 0 at offset_mm ... 1 at the other end
  double radius_at_mm(double axis_fraction) const { return radius_mm + radius_change_mm * axis_fraction; }
};
/// Maximum number of parts of a tool.
inline constexpr std::size_t kMaxToolParts = 4;

/// Closest approach of a tool part to a surface.
struct NearestPart {
  /// Signed distance from the nearest point of the part's axis to the surface, minus the increase of the
  /// capsule's radius from offset_mm to that point; mm. The clearance is distance_mm - ToolPart::radius_mm.
  double distance_mm = 0;
  double axis_fraction = 0;  ///< Position on the axis, 0 ... 1
};
/// Closest approach, evaluated on the same row of spheres that the proxy uses for a capsule. Does not
/// allocate, lock or throw.
/// @param at         position of the tip
/// @param cutoff_mm  early-out for capsules: if the distance is nowhere below this, the result may be any
///                   lower bound above it
NearestPart nearest_part(const Surface& surface, const ToolPart& part, const Point<Patient>& at,
                         double cutoff_mm = std::numeric_limits<double>::infinity());

/// Pose of the tool as held by the operator.
struct ToolPose {
  Point<Patient> tip;           ///< Position of the tip; finite
  Eigen::Quaterniond attitude;  ///< Rotation from tool axes to patient axes; unit quaternion

  /// Pose with the tip at `at`; the attitude defaults to the identity.
  /// @param turned  attitude; any non-zero norm, normalised by the constructor
  ToolPose(const Point<Patient>& at, const Eigen::Quaterniond& turned = Eigen::Quaterniond::Identity())
      : tip(at), attitude(turned.normalized()) {}
};

/// Tool parts rotated from one attitude to another. Bit-identical to the input if both attitudes are equal.
class RotatedTool {
 public:
  /// @param parts  parts in attitude `from`; at most kMaxToolParts
  RotatedTool(std::span<const ToolPart> parts, const Eigen::Quaterniond& from, const Eigen::Quaterniond& to);
  std::span<const ToolPart> parts() const { return {parts_.data(), count_}; }

 private:
  std::array<ToolPart, kMaxToolParts> parts_;
  std::size_t count_;
};

}  // namespace palpate
