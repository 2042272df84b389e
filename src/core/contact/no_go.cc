#include "palpate/contact/no_go.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string>
#include <utility>

namespace palpate {
namespace {

/// An active region.
struct ActiveRegion {
  int region = -1;
  Vector<Patient> outward;  // unit
  Vector<Patient> arm_mm;   // from the tip to the point of action
  double depth_mm = 0;
  double stiffness_N_per_mm = 0;  // stiffness of the region alone
};

/// Closest approach of a tool to a region, and the outward direction there.
struct NearRegion {
  double distance_mm;
  Point<Patient> centre;
  Vector<Patient> outward;
  double radius_mm;
};

void retain_nearest(const NearRegion& one, std::optional<NearRegion>& nearest) {
  if (!nearest || one.distance_mm < nearest->distance_mm) nearest = one;
}

std::optional<NearRegion> nearest_to(const NoGoPlane& plane, std::span<const ToolPart> parts,
                                     const Point<Patient>& tip) {
  std::optional<NearRegion> nearest;
  for (const ToolPart& part : parts)
    // with a linearly changing radius the extremum is at one of the ends
    for (const double axis_fraction : {0.0, 1.0}) {
      const Point<Patient> centre = tip + part.offset_mm + part.axis_mm * axis_fraction;
      const double radius_mm = part.radius_at_mm(axis_fraction);
      retain_nearest({plane.outward.dot(centre - plane.point) - radius_mm, centre, plane.outward, radius_mm},
                     nearest);
    }
  return nearest;
}

// position on a tapered capsule's axis where the line from the point is perpendicular to its outline
double nearest_axis_fraction(const ToolPart& part, const Vector<Patient>& to_point) {
  const double length2 = part.axis_mm.squared_norm();
  if (!(length2 > 0)) return 0;
  const double foot = to_point.dot(part.axis_mm) / length2;
  const double beside_mm = (to_point - part.axis_mm * foot).norm();
  const double slant2 = length2 - part.radius_change_mm * part.radius_change_mm;
  const double ahead = slant2 > 0 ? beside_mm * part.radius_change_mm / std::sqrt(slant2 * length2) : 0;
  return std::clamp(foot + ahead, 0.0, 1.0);
}

std::optional<NearRegion> nearest_to(const NoGoSphere& ball, std::span<const ToolPart> parts,
                                     const Point<Patient>& tip) {
  std::optional<NearRegion> nearest;
  for (const ToolPart& part : parts) {
    const Point<Patient> end = tip + part.offset_mm;
    const double axis_fraction = nearest_axis_fraction(part, ball.centre - end);
    const Point<Patient> centre = end + part.axis_mm * axis_fraction;
    const Vector<Patient> displacement = centre - ball.centre;
    const double radius_mm = part.radius_at_mm(axis_fraction);
    retain_nearest(
        {displacement.norm() - ball.radius_mm - radius_mm, centre, displacement.normalized(), radius_mm},
        nearest);
  }
  return nearest;
}

std::optional<NearRegion> nearest_to(const NoGoStructure& structure, const DistanceTrees& trees,
                                     std::span<const ToolPart> parts, const Point<Patient>& tip,
                                     double within_mm) {
  if (structure.tracked < 0) return {};
  const auto tracked = static_cast<std::size_t>(structure.tracked);
  if (!(trees.lower_bound_mm(tracked, box_of_tool(parts, tip)) <= within_mm)) return {};
  const SurfaceTree& tree = *trees.structures()[tracked].tree;
  const auto near = distance_of_tool(tree, parts, tip, within_mm);
  if (!near) return {};
  return NearRegion{near->distance_mm, near->centre, tree.outward(near->centre, near->near), near->radius_mm};
}

std::optional<NearRegion> nearest_to(const NoGoRegion& region, const DistanceTrees& trees,
                                     std::span<const ToolPart> parts, const Point<Patient>& tip) {
  if (const auto* plane = std::get_if<NoGoPlane>(&region.shape)) return nearest_to(*plane, parts, tip);
  if (const auto* ball = std::get_if<NoGoSphere>(&region.shape)) return nearest_to(*ball, parts, tip);
  return nearest_to(*std::get_if<NoGoStructure>(&region.shape), trees, parts, tip, region.keep_away_mm);
}

/// Active regions in order of decreasing depth, up to the capacity.
class ActiveRegions {
 public:
  void add(const ActiveRegion& region) {
    const auto end = regions_.begin() + static_cast<std::ptrdiff_t>(count_);
    const auto insertion = std::upper_bound(
        regions_.begin(), end, region,
        [](const ActiveRegion& a, const ActiveRegion& b) { return a.depth_mm > b.depth_mm; });
    if (insertion == regions_.end()) return;
    if (count_ < regions_.size()) ++count_;
    const auto last = regions_.begin() + static_cast<std::ptrdiff_t>(count_) - 1;
    std::move_backward(insertion, last, last + 1);
    *insertion = region;
  }
  std::span<const ActiveRegion> all() const { return {regions_.data(), count_}; }

 private:
  std::array<ActiveRegion, kMaxActiveNoGo> regions_;
  std::size_t count_ = 0;
};

/// Energy of all active springs in series with the spring to the tip.
class Envelope {
 public:
  Envelope(std::span<const ActiveRegion> active, double max_N_per_mm)
      : active_(active), max_N_per_mm_(max_N_per_mm) {
    // spring that, in series with the spring to the tip, has the region's own stiffness
    for (std::size_t n = 0; n < active_.size(); ++n) {
      const double stiffness_N_per_mm = active_[n].stiffness_N_per_mm;
      spring_[n] = stiffness_N_per_mm * max_N_per_mm_ / (max_N_per_mm_ - stiffness_N_per_mm);
    }
  }

  double energy_mJ(const Eigen::Vector3d& u) const {
    double energy_mJ = 0.5 * max_N_per_mm_ * u.squaredNorm();
    for (std::size_t n = 0; n < active_.size(); ++n) {
      const double deep_mm = depth_mm(n, u);
      energy_mJ += 0.5 * spring_[n] * deep_mm * deep_mm;
    }
    return energy_mJ;
  }

  // Newton's method with line search; the function is convex and piecewise quadratic
  Eigen::Vector3d minimiser() const {
    constexpr int kSteps = 32, kHalvings = 24;
    constexpr double kConverged_mm = 1e-9, kArmijo = 1e-4;
    Eigen::Vector3d u = Eigen::Vector3d::Zero();
    for (int step = 0; step < kSteps; ++step) {
      Eigen::Vector3d gradient = max_N_per_mm_ * u;
      Eigen::Matrix3d hessian = max_N_per_mm_ * Eigen::Matrix3d::Identity();
      for (std::size_t n = 0; n < active_.size(); ++n) {
        const double deep_mm = depth_mm(n, u);
        if (!(deep_mm > 0)) continue;
        const Eigen::Vector3d& out = active_[n].outward.eigen();
        gradient -= spring_[n] * deep_mm * out;
        hessian += spring_[n] * out * out.transpose();
      }
      const Eigen::Vector3d displacement = hessian.ldlt().solve(-gradient);
      if (!(displacement.norm() > kConverged_mm)) break;
      double step_length = 1;
      const double before_mJ = energy_mJ(u), gain = kArmijo * gradient.dot(displacement);
      for (int n = 0;
           n < kHalvings && energy_mJ(u + step_length * displacement) > before_mJ + step_length * gain; ++n)
        step_length *= 0.5;
      u += step_length * displacement;
    }
    return u;
  }

  double force_N(std::size_t n, const Eigen::Vector3d& u) const { return spring_[n] * depth_mm(n, u); }

 private:
  double depth_mm(std::size_t n, const Eigen::Vector3d& u) const {
    return std::max(0.0, active_[n].depth_mm - active_[n].outward.eigen().dot(u));
  }

  std::span<const ActiveRegion> active_;
  double max_N_per_mm_;
  std::array<double, kMaxActiveNoGo> spring_;
};

// regions without series spring: forces add up
void add_unlimited(std::span<const ActiveRegion> active, NoGoForce& total) {
  for (const ActiveRegion& region : active) {
    const Vector<Patient> force_N = region.outward * (region.stiffness_N_per_mm * region.depth_mm);
    total.force_N += force_N;
    total.torque_Nmm += region.arm_mm.cross(force_N);
    total.stored_mJ += 0.5 * region.stiffness_N_per_mm * region.depth_mm * region.depth_mm;
  }
}

void add_limited(std::span<const ActiveRegion> active, double max_N_per_mm, NoGoForce& total) {
  const Envelope envelope(active, max_N_per_mm);
  const Eigen::Vector3d u = envelope.minimiser();
  for (std::size_t n = 0; n < active.size(); ++n) {
    const Vector<Patient> force_N = active[n].outward * envelope.force_N(n, u);
    total.force_N += force_N;
    total.torque_Nmm += active[n].arm_mm.cross(force_N);
  }
  total.stored_mJ = envelope.energy_mJ(u);
}

}  // namespace

Result<void> check_no_go(std::span<const NoGoRegion> regions) {
  const auto wrong = [](std::string what, std::string remedy) {
    return Error{ErrorKind::kBadInput, std::move(what), "", std::move(remedy)};
  };
  if (regions.size() > kMaxNoGo)
    return wrong("there are " + std::to_string(regions.size()) + " no-go regions",
                 "a model has at most " + std::to_string(kMaxNoGo) + ": leave out the others");
  for (const NoGoRegion& region : regions) {
    const std::string name = "no-go region \"" + region.name + "\": ";
    const auto is_in = [](double value, const auto& range) {
      return value >= range.min && value <= range.max;
    };
    if (!(region.keep_away_mm >= 0 && region.keep_away_mm <= kMaxKeepAway_mm))
      return wrong(name + "the distance to keep away is " + std::to_string(region.keep_away_mm) + " mm",
                   "give 0 to 20 mm");
    if (!is_in(region.stiffness_N_per_mm, kNoGoStiffness_N_per_mm))
      return wrong(name + "the stiffness is " + std::to_string(region.stiffness_N_per_mm) + " N/mm",
                   "give 0.01 to 20 N/mm");
    if (const auto* plane = std::get_if<NoGoPlane>(&region.shape))
      if (!plane->point.all_finite() || !(std::abs(plane->outward.norm() - 1) < 1e-6))
        return wrong(name + "the plane has no valid point or direction",
                     "give a point, and a unit vector towards the permitted side");
    if (const auto* ball = std::get_if<NoGoSphere>(&region.shape))
      if (!ball->centre.all_finite() || !is_in(ball->radius_mm, kNoGoRadius_mm))
        return wrong(name + "the sphere has no valid centre, or a radius of " +
                         std::to_string(ball->radius_mm) + " mm",
                     "give a centre, and a radius of 0.1 to 500 mm");
  }
  return {};
}

NoGoForce no_go_force(std::span<const NoGoRegion> regions, const DistanceTrees& trees,
                      std::span<const ToolPart> parts, const Point<Patient>& tip,
                      double max_stiffness_N_per_mm) {
  // a series spring needs a region softer than the limit: at equality its own stiffness would be infinite
  constexpr double kMaxFractionOfLimit = 0.9;
  NoGoForce all;
  // NaN: the limit is unknown, and the stiffness is not limited
  const bool capped = max_stiffness_N_per_mm < std::numeric_limits<double>::infinity();
  if (capped && !(max_stiffness_N_per_mm > 0)) return all;
  ActiveRegions active;
  for (std::size_t r = 0; r < regions.size(); ++r) {
    const NoGoRegion& region = regions[r];
    const std::optional<NearRegion> near = nearest_to(region, trees, parts, tip);
    if (!near || !(near->distance_mm < region.keep_away_mm)) continue;
    const double stiffness =
        capped ? std::min(region.stiffness_N_per_mm, kMaxFractionOfLimit * max_stiffness_N_per_mm)
               : region.stiffness_N_per_mm;
    active.add({static_cast<int>(r), near->outward, near->centre - near->outward * near->radius_mm - tip,
                region.keep_away_mm - near->distance_mm, stiffness});
  }
  if (active.all().empty()) return all;
  all.region = active.all().front().region;
  all.depth_mm = active.all().front().depth_mm;
  for (const ActiveRegion& one : active.all())
    all.stiffness_N_per_mm = std::max(all.stiffness_N_per_mm, one.stiffness_N_per_mm);
  if (capped && active.all().size() > 1)
    add_limited(active.all(), max_stiffness_N_per_mm, all);
  else
    add_unlimited(active.all(), all);
  return all;
}

}  // namespace palpate
