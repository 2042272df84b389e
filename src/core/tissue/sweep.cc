#include "palpate/tissue/sweep.h"

#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

// distance of a point from the path of a ball's centre; `from` is relative to the path's start
double to_path_mm(const Vector<Patient>& displacement, double squared, const Vector<Patient>& from) {
  const double fraction = squared > 0 ? std::clamp(from.dot(displacement) / squared, 0.0, 1.0) : 0.0;
  return (from - displacement * fraction).norm();
}

}  // namespace

double Sweep::max_radius_mm() const {
  return is_of_ball() ? radius_mm : std::max(radius_mm, end_radius_mm);
}

SweptShape::SweptShape(const Sweep& sweep)
    : sweep_(sweep), path_(sweep.to - sweep.from), path_squared_(path_.squared_norm()) {
  const Eigen::Array3d from = sweep.from.eigen().array(), to = sweep.to.eigen().array();
  low_ = from.min(to);
  high_ = from.max(to);
  if (sweep.is_of_ball()) return;
  const Eigen::Array3d axis = sweep.axis_mm.eigen().array();
  low_ = low_.min(low_ + axis);
  high_ = high_.max(high_ + axis);
  radius_change_mm_ = sweep.end_radius_mm - sweep.radius_mm;
  axis_squared_ = sweep.axis_mm.squared_norm();
  slope_ = radius_change_mm_ / std::sqrt(axis_squared_);
  sine_ = std::abs(slope_) < 1 ? std::sqrt(1 - slope_ * slope_) : 0;

  // a path along the axis, or a zero one, spans no plane with it
  constexpr double kMinSine = 1e-6;
  const Vector<Patient> across = path_.cross(sweep.axis_mm);
  determinant_ = across.squared_norm();
  if (!(determinant_ > kMinSine * kMinSine * path_squared_ * axis_squared_)) return;
  normal_ = across / std::sqrt(determinant_);
  dot_ = path_.dot(sweep.axis_mm);
  // the gradient is orthogonal to the path, along which the radius is constant
  const Vector<Patient> off_path = sweep.axis_mm - path_ * (dot_ / path_squared_);
  gradient_ = off_path * (radius_change_mm_ / off_path.squared_norm());
  const double squared = gradient_.squared_norm();
  has_inside_ = squared < 1;
  if (has_inside_) plane_sine_ = std::sqrt(1 - squared);
}

double SweptShape::head_depth_mm(const Vector<Patient>& from) const {
  double fraction = 0;
  if (sine_ > 0) {
    const double foot = from.dot(sweep_.axis_mm) / axis_squared_;
    const double height_mm = (from - sweep_.axis_mm * foot).norm();
    fraction = std::clamp(foot + slope_ * height_mm / (sine_ * std::sqrt(axis_squared_)), 0.0, 1.0);
  } else {
    // one ball contains the other
    fraction = slope_ > 0 ? 1 : 0;
  }
  return sweep_.radius_mm + radius_change_mm_ * fraction - (from - sweep_.axis_mm * fraction).norm();
}

double SweptShape::depth_mm(const Point<Patient>& at) const {
  const Vector<Patient> from = at - sweep_.from;
  const double first_mm = sweep_.radius_mm - to_path_mm(path_, path_squared_, from);
  if (sweep_.is_of_ball()) return first_mm;
  if (has_inside_) {
    const double height_mm = std::abs(from.dot(normal_));
    const Vector<Patient> best = from + gradient_ * (height_mm / plane_sine_);
    // coordinates along path and axis, by Cramer's rule
    const double by_path = best.dot(path_), by_axis = best.dot(sweep_.axis_mm);
    const double s = by_path * axis_squared_ - by_axis * dot_, t = by_axis * path_squared_ - by_path * dot_;
    if (s >= 0 && s <= determinant_ && t >= 0 && t <= determinant_)
      return sweep_.radius_mm + gradient_.dot(from) - height_mm * plane_sine_;
  }
  const double last_mm = sweep_.end_radius_mm - to_path_mm(path_, path_squared_, from - sweep_.axis_mm);
  return std::max({first_mm, last_mm, head_depth_mm(from), head_depth_mm(from - path_)});
}

double distance_to_path_mm(const Sweep& sweep, const Point<Patient>& at) {
  const Vector<Patient> displacement = sweep.to - sweep.from;
  return to_path_mm(displacement, displacement.squared_norm(), at - sweep.from);
}

}  // namespace palpate
