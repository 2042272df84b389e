#include "work.h"

#include <cmath>
#include <random>

namespace palpate::bench {

namespace {

constexpr double kRadius_mm = 24, kGap_mm = 3;

/// From the middle between the bones to the centre of the second one's rounded end.
const Eigen::Vector3d kToEnd(0, kRadius_mm + kGap_mm / 2, 0);

}  // namespace

GridGeometry founding_grid() {
  GridGeometry grid;
  grid.dims = {256, 256, 124};
  grid.spacing_mm = {0.625, 0.625, 0.9};
  return grid;
}

Volume<std::uint8_t> two_bones() {
  Volume<std::uint8_t> volume(founding_grid());
  const GridGeometry& grid = volume.geometry();
  const auto inside = [](const Eigen::Vector3d& p, const Eigen::Vector3d& end, double away) {
    const double along = (p[1] - end[1]) * away;
    const double across = std::hypot(p[0] - end[0], p[2] - end[2]);
    return along > 0 ? across < kRadius_mm : std::hypot(across, along) < kRadius_mm;
  };
  const Eigen::Vector3d centre = grid.centre().eigen();
  for (int k = 0; k < grid.dims[2]; ++k) {
    for (int j = 0; j < grid.dims[1]; ++j) {
      for (int i = 0; i < grid.dims[0]; ++i) {
        const Eigen::Vector3d p = (grid.X_PatientVoxel() * Point<Voxel>(i, j, k)).eigen();
        const bool bone = inside(p, centre - kToEnd, -1) || inside(p, centre + kToEnd, 1);
        volume.at(i, j, k) = bone ? 255 : 0;
      }
    }
  }
  return volume;
}

std::vector<Point<Patient>> probe_path(std::size_t count) {
  // great circles in a slowly rotating plane, on the half of the end that faces the gap
  constexpr double kStep_mm = 0.05, kTurn = 0.03;
  const Eigen::Vector3d end = founding_grid().centre().eigen() - kToEnd;
  std::vector<Point<Patient>> path(count);
  for (std::size_t n = 0; n < count; ++n) {
    const double along = kStep_mm / kRadius_mm * static_cast<double>(n);
    const double tilt = 1.4 * std::sin(along), plane = kTurn * along;
    const Eigen::Vector3d out(std::sin(tilt) * std::cos(plane), std::cos(tilt),
                              std::sin(tilt) * std::sin(plane));
    path[n] = Point<Patient>(end + kRadius_mm * out);
  }
  return path;
}

std::vector<Point<Patient>> random_points(std::size_t count, double margin) {
  const GridGeometry grid = founding_grid();
  std::mt19937 random(1);
  std::vector<Point<Patient>> points(count);
  for (auto& point : points) {
    Point<Voxel> x;
    for (int axis = 0; axis < 3; ++axis) {
      x[axis] = std::uniform_real_distribution<double>(margin, grid.dims[axis] - 1 - margin)(random);
    }
    point = grid.X_PatientVoxel() * x;
  }
  return points;
}

}  // namespace palpate::bench
