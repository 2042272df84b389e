#include "verification/accuracy_meter.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "palpate/direct/force_field.h"
#include "verification/accuracy.h"

namespace palpate {

double degrees_between(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  if (a.squaredNorm() == 0) return 180;
  return std::atan2(a.cross(b).norm(), a.dot(b)) * 180 / std::numbers::pi;
}

void add_spread(std::vector<Figure>& figures, const std::string& path, const char* unit,
                std::vector<double> values, WithMean with_mean) {
  if (values.empty()) return;
  std::sort(values.begin(), values.end());
  const auto n = values.size();
  double sum = 0;
  for (const double value : values) sum += value;
  const auto add = [&](const char* leaf, double value) {
    const std::string name = path + "/" + leaf;
    figures.push_back({name, value, unit, n, accuracy_limit(name)});
  };
  if (with_mean == kWithMean) add("mean", sum / static_cast<double>(n));
  add("p99", values[(n * 99 + 99) / 100 - 1]);
  add("max", values.back());
}

std::vector<Point<Patient>> constant_depth_path(const Shape& shape, const Point<Patient>& start,
                                                const Vector<Patient>& direction, double step_mm, int count) {
  const double depth = shape.distance_mm(start);
  Eigen::Vector3d normal = shape.normal(start).eigen(), ahead = direction.eigen();
  std::vector<Point<Patient>> path{start};
  for (int n = 0; n < count; ++n) {
    ahead = (ahead - ahead.dot(normal) * normal).normalized();
    Point<Patient> next = path.back() + Vector<Patient>(step_mm * ahead);
    // restore the depth: the distance is exact, so a single correction along the normal suffices
    normal = shape.normal(next).eigen();
    next += Vector<Patient>((depth - shape.distance_mm(next)) * normal);
    path.push_back(next);
  }
  return path;
}

std::vector<double> force_changes_percent(const Sampler& sample, const std::vector<Point<Patient>>& path) {
  std::vector<double> changes;
  Vector<Patient> before;
  for (std::size_t n = 0; n < path.size(); ++n) {
    const Vector<Patient> force = normal_force(sample(path[n]), 1);
    if (n > 0) changes.push_back(100 * (force - before).norm());
    before = force;
  }
  return changes;
}

bool same_nearest_voxel(const Point<Voxel>& a, const Point<Voxel>& b) {
  return ((a.eigen().array() + 0.5).floor() == (b.eigen().array() + 0.5).floor()).all();
}

}  // namespace palpate
