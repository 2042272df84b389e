#include "contact/footprint.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "palpate/contact/contact_settings.h"

namespace palpate {
namespace {

// smoothstep of the depth difference: 0 if a is shallower by half a radius or more, 1 if it is as much deeper
double is_deeper(double a_mm, double b_mm, double radius_mm) {
  const double fraction = std::clamp((a_mm - b_mm) / radius_mm + 0.5, 0.0, 1.0);
  return fraction * fraction * (3 - 2 * fraction);
}

}  // namespace

double pair_interaction_per_mm(double lateral_mm, double radius_mm, double base_per_mm) {
  const double per_mm = lateral_mm < radius_mm ? lateral_mm / radius_mm / (std::numbers::pi * radius_mm)
                                               : 1 / (std::numbers::pi * lateral_mm);
  const double x = 0.5 * std::numbers::pi * base_per_mm * lateral_mm;
  return x < 1 ? per_mm + 0.5 * base_per_mm * x : base_per_mm;
}

Footprint footprint_of(std::span<const FootprintPoint> points, const Vector<Patient>& along,
                       double base_per_mm) {
  PALPATE_CHECK(!points.empty() && points.size() <= kMaxFootprintPoints);
  std::array<double, kMaxFootprintPoints> weight;
  weight.fill(1);
  const auto radius_mm = [&](std::size_t a, std::size_t b) {
    return std::min(points[a].radius_mm, points[b].radius_mm);
  };
  // squared lateral distances of all pairs; up to 276 square roots and divisions dominate the cost of this
  // function, so they are evaluated only where they affect the result
  std::array<double, kMaxFootprintPoints*(kMaxFootprintPoints - 1) / 2> lateral_mm2;
  std::size_t pair = 0;
  for (std::size_t a = 0; a < points.size(); ++a)
    for (std::size_t b = 0; b < a; ++b, ++pair) {
      const Vector<Patient> displacement = points[a].centre_mm - points[b].centre_mm;
      lateral_mm2[pair] = (displacement - along * displacement.dot(along)).squared_norm();
      const double radius = radius_mm(a, b);
      if (!(lateral_mm2[pair] < radius * radius)) continue;
      const double overlap = 1 - std::min(1.0, std::sqrt(lateral_mm2[pair]) / radius);
      const double deeper = is_deeper(points[a].depth_mm, points[b].depth_mm, radius);
      weight[b] *= 1 - overlap * deeper;
      weight[a] *= 1 - overlap * (1 - deeper);
    }

  // sums of sqrt(R) d^n, n = 0.5, 1.5, 2.5
  std::array<double, kMaxFootprintPoints> force;
  double stiffness_sum = 0, force_sum = 0, work = 0;
  Footprint foot;
  for (std::size_t n = 0; n < points.size(); ++n) {
    const FootprintPoint& point = points[n];
    const double root = weight[n] * std::sqrt(point.radius_mm * point.depth_mm);
    force[n] = root * point.depth_mm;
    stiffness_sum += root;
    force_sum += force[n];
    work += force[n] * point.depth_mm;
    foot.arm_mm += (point.centre_mm - along * point.radius_mm) * force[n];
  }
  if (!(force_sum > 0)) {
    // the contact is so slight that its force rounds to 0
    foot.depth_mm = points[0].depth_mm;
    foot.radius_mm = points[0].radius_mm;
    foot.arm_mm = points[0].centre_mm - along * points[0].radius_mm;
    return foot;
  }
  foot.depth_mm = work / force_sum;
  foot.radius_mm = force_sum * force_sum / (foot.depth_mm * foot.depth_mm * foot.depth_mm);
  foot.stiffness_ratio = std::max(1.0, stiffness_sum * work / (force_sum * force_sum));
  foot.arm_mm = foot.arm_mm * (1 / force_sum);
  for (std::size_t n = 0; n < points.size(); ++n) force[n] /= force_sum;
  pair = 0;
  for (std::size_t a = 0; a < points.size(); ++a)
    for (std::size_t b = 0; b < a; ++b, ++pair) {
      foot.interaction_per_mm +=
          2 * force[a] * force[b] *
          pair_interaction_per_mm(std::sqrt(lateral_mm2[pair]), radius_mm(a, b), base_per_mm);
    }
  return foot;
}

std::size_t find_press_points(std::span<const ContactSurface> surfaces, std::span<const int> touched,
                              std::span<const ToolPart> parts, const Point<Patient>& tip,
                              std::span<FootprintPoint> points) {
  const std::size_t largest =
      std::min(points.size(), kMaxFootprintPoints) / std::max<std::size_t>(1, parts.size());
  std::size_t count = 0;
  for (const ToolPart& part : parts) {
    const double length_mm = part.axis_mm.norm();
    // positions on the axis are independent of the capsule's attitude, so that no place appears or vanishes
    // in a rotation
    const double radius = std::max({part.radius_mm, part.radius_at_mm(1), kSoftTissueSettings.min_radius_mm});
    const int steps = length_mm > 0
                          ? std::clamp(static_cast<int>(length_mm / radius), 1, static_cast<int>(largest) - 1)
                          : 0;
    for (int n = 0; n <= steps; ++n) {
      const double fraction = steps == 0 ? 0 : static_cast<double>(n) / steps;
      FootprintPoint point{part.offset_mm + part.axis_mm * fraction, part.radius_at_mm(fraction), 0};
      for (const int s : touched) {
        const ContactSurface& surface = surfaces[static_cast<std::size_t>(s)];
        if (surface.surface == nullptr) continue;
        const double depth_mm = point.radius_mm - surface.surface->distance_mm(tip + point.centre_mm);
        point.depth_mm = std::max(point.depth_mm, depth_mm);
      }
      // a thinner part presses like a sphere of the minimum radius at the same depth
      point.radius_mm = std::max(point.radius_mm, kSoftTissueSettings.min_radius_mm);
      if (point.depth_mm > 0) points[count++] = point;
    }
  }
  return count;
}

}  // namespace palpate
