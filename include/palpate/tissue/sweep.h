#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "palpate/geometry/geometry.h"

/// What the head of a burr takes with it on a short straight way, and how deep a place lies in that.
namespace palpate {

/// A head is a ball, or a row of balls that goes on without gaps: the first ball's middle is where the tool's
/// tip is, the last one's lies `axis_mm` away, and the radius changes evenly from one to the other (the
/// convex hull of both balls). Equal radii are a cylinder with round ends, others a cone with round ends. It
/// does not turn on its way.
struct Sweep {
  Point<Patient> from, to;  ///< of the first ball's middle
  double radius_mm = 0;     ///< of the first ball; above 0
  /// By which it can be undone, counted from the motor's first start (StrokeHistory). No part of its shape.
  std::uint32_t stroke = 0;
  Vector<Patient> axis_mm = {};  ///< from the first ball's middle to the last one's; 0: there is one ball
  double end_radius_mm = 0;      ///< of the last ball, above 0; of one ball alone no part of its shape

  bool is_of_ball() const { return axis_mm == Vector<Patient>(); }
  /// The radius of the widest ball.
  double widest_mm() const;
};

/// A sweep, made ready for being asked at many places.
///
/// The depth of a place p in it is the greatest, over s and t from 0 to 1, of
///
///     r(t) - |p - (from + s (to - from) + t axis)|,      r(t) = radius + t (end_radius - radius)
///
/// which is concave in (s, t) together. In the plane of way and axis r has a gradient g. With h the height
/// of p above the plane and q its foot, the greatest anywhere in the plane is at q + g h / sqrt(1 - g^2),
/// where it is r(q) - h sqrt(1 - g^2). Where that lies outside of the parallelogram, or where g is 1 or more,
/// the greatest lies on its edges: two are ways of a ball, two are heads that stand still, of which the same
/// holds on a line.
class SweptShape {
 public:
  explicit SweptShape(const Sweep& sweep);

  /// mm; positive within, 0 on the outline. Outside it is the distance to the outline, with a minus.
  double depth_mm(const Point<Patient>& at) const;
  /// The least box around its balls' middles, in the patient.
  const Eigen::Array3d& low() const { return low_; }
  const Eigen::Array3d& high() const { return high_; }
  double widest_mm() const { return sweep_.widest_mm(); }

 private:
  // a head that stands still, at `from`: its depth at a place that is given from there
  double head_depth_mm(const Vector<Patient>& from) const;

  Sweep sweep_;
  Eigen::Array3d low_, high_;
  Vector<Patient> way_;
  double way_squared_ = 0, axis_squared_ = 0;
  double widens_mm_ = 0;  // from the first ball to the last
  // of the head: how fast the radius changes along the axis, and the sine that belongs to it
  double slope_ = 0, sine_ = 0;
  // of the plane: where its own greatest is looked for; dot products to solve for s and t
  bool has_inside_ = false;
  Vector<Patient> normal_, gradient_;
  double dot_ = 0, determinant_ = 0, plane_sine_ = 0;
};

/// From the way of the first ball's middle; mm, at least 0.
double distance_to_way_mm(const Sweep& sweep, const Point<Patient>& at);

}  // namespace palpate
