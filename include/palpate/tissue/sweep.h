#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "palpate/geometry/geometry.h"

/// Volume swept by a burr's head along a short straight path, and the depth of a point in it.
namespace palpate {

/// A head is a ball or a continuous row of balls: the first ball's centre is at the tool's tip, the last
/// one's is displaced by `axis_mm`, and the radius changes linearly in between (the convex hull of both
/// balls). Equal radii form a cylinder with round ends, others a cone with round ends. The head does not
/// rotate within a sweep.
struct Sweep {
  Point<Patient> from, to;  ///< Centre of the first ball
  double radius_mm = 0;     ///< Radius of the first ball, above 0
  /// Stroke for undo, counted from the motor's first start (StrokeHistory). Not part of the shape.
  std::uint32_t stroke = 0;
  Vector<Patient> axis_mm = {};  ///< From the first ball's centre to the last one's; 0: a single ball
  double end_radius_mm = 0;      ///< Radius of the last ball, above 0; unused for a single ball

  bool is_of_ball() const { return axis_mm == Vector<Patient>(); }
  /// Radius of the larger ball.
  double max_radius_mm() const;
};

/// A sweep prepared for evaluation at many points.
///
/// The depth of a point p in it is the maximum, over s and t from 0 to 1, of
///
///     r(t) - |p - (from + s (to - from) + t axis)|,      r(t) = radius + t (end_radius - radius)
///
/// which is concave in (s, t). In the plane of path and axis r has a gradient g. With h the height of p above
/// the plane and q its foot, the maximum over the whole plane is at q + g h / sqrt(1 - g^2), where it is r(q)
/// - h sqrt(1 - g^2). If that point lies outside the parallelogram, or if g is 1 or more, the maximum lies on
/// its edges: two are paths of a ball, two are stationary heads, for which the same holds on a line.
class SweptShape {
 public:
  explicit SweptShape(const Sweep& sweep);

  /// Depth of a point, mm: positive inside, 0 on the outline, minus the distance to the outline outside.
  double depth_mm(const Point<Patient>& at) const;
  /// Bounding box of the ball centres, in the patient.
  const Eigen::Array3d& low() const { return low_; }
  const Eigen::Array3d& high() const { return high_; }
  double max_radius_mm() const { return sweep_.max_radius_mm(); }

 private:
  // depth of a point in a stationary head at `from`, in coordinates relative to it
  double head_depth_mm(const Vector<Patient>& from) const;

  Sweep sweep_;
  Eigen::Array3d low_, high_;
  Vector<Patient> path_;
  double path_squared_ = 0, axis_squared_ = 0;
  double radius_change_mm_ = 0;  // from the first ball to the last
  // head: slope of the radius along the axis, and the sine of the cone's generator to it
  double slope_ = 0, sine_ = 0;
  // plane of path and axis: whether its interior is tested; quantities for solving for s and t
  bool has_inside_ = false;
  Vector<Patient> normal_, gradient_;
  double dot_ = 0, determinant_ = 0, plane_sine_ = 0;
};

/// Distance to the path of the first ball's centre; mm, at least 0.
double distance_to_path_mm(const Sweep& sweep, const Point<Patient>& at);

}  // namespace palpate
