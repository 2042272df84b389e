#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "palpate/sampling/surface.h"

/// Brute-force distance to a surface in double precision, for tests.
namespace palpate::testing {

/// Zero set of the trilinear interpolant of a surface's position. Along a grid line the interpolant is linear
/// in every cell, so its zeros there are exact. A few lines per cell are sampled first, then many lines of
/// the cells that can contain the nearest point, then that line is shifted while the distance decreases.
class SurfaceOracle {
 public:
  explicit SurfaceOracle(const Surface& surface)
      : voxels_(surface.distance_field().bricks().dense()),
        steps_(surface.distance_field().steps()),
        X_PatientVoxel_(voxels_.geometry().X_PatientVoxel()) {
    const auto& dims = voxels_.geometry().dims;
    for (int k = -1; k < dims[2]; ++k)
      for (int j = -1; j < dims[1]; ++j)
        for (int i = -1; i < dims[0]; ++i) {
          const Cell cell = cell_at(i, j, k);
          if (!cell.is_crossed()) continue;
          cells_.push_back(cell);
          for_lines(kFewLines, [&](const Line& line) {
            if (const auto t = cell.crossing(line)) points_.push_back(position_of(cell, line, *t));
          });
        }
  }

  bool empty() const { return cells_.empty(); }
  /// Points on the surface.
  const std::vector<Eigen::Vector3d>& points() const { return points_; }

  /// Unsigned distance; infinite if there is no surface.
  double distance_mm(const Point<Patient>& x) const {
    double nearest2 = std::numeric_limits<double>::infinity();
    for (const Eigen::Vector3d& position : points_)
      nearest2 = std::min(nearest2, (position - x.eigen()).squaredNorm());
    // a corner cut off by the surface may lie between the sampled lines
    double best_mm = std::sqrt(nearest2);
    const double half_mm = 0.5 * voxels_.geometry().spacing_mm.norm();
    for (const Cell& cell : cells_) {
      const Eigen::Vector3d centre = cell.first + Eigen::Vector3d::Constant(0.5);
      if (((X_PatientVoxel_ * Point<Voxel>(centre)).eigen() - x.eigen()).norm() - half_mm < best_mm)
        inspect_closely(cell, x.eigen(), best_mm);
    }
    return best_mm;
  }

 private:
  static constexpr int kFewLines = 6, kManyLines = 20;

  // grid line along an axis, at fixed coordinates on the two others
  struct Line {
    std::size_t axis;
    double u, v;
  };
  struct Cell {
    Eigen::Vector3d first;
    std::array<double, 8> mm;

    bool is_crossed() const {
      const auto inside = std::count_if(mm.begin(), mm.end(), [](double value) { return value < 0; });
      return inside != 0 && inside != 8;
    }
    double at(const Eigen::Vector3d& p) const {
      const auto row = [&](std::size_t n) { return std::lerp(mm[n], mm[n + 1], p[0]); };
      return std::lerp(std::lerp(row(0), row(2), p[1]), std::lerp(row(4), row(6), p[1]), p[2]);
    }
    static Eigen::Vector3d on(const Line& line, double t) {
      Eigen::Vector3d p;
      p[static_cast<int>(line.axis)] = t;
      p[static_cast<int>((line.axis + 1) % 3)] = line.u;
      p[static_cast<int>((line.axis + 2) % 3)] = line.v;
      return p;
    }
    std::optional<double> crossing(const Line& line) const {
      const double a = at(on(line, 0)), b = at(on(line, 1));
      if ((a < 0) == (b < 0)) return {};
      return a / (a - b);
    }
  };

  Cell cell_at(int i, int j, int k) const {
    Cell cell{Eigen::Vector3d(i, j, k), {}};
    for (int n = 0; n < 8; ++n)
      cell.mm[static_cast<std::size_t>(n)] =
          steps_.offset +
          steps_.scale * voxels_.at_or(i + (n & 1), j + (n >> 1 & 1), k + (n >> 2), steps_.outside);
    return cell;
  }
  template <class Visit>
  static void for_lines(int lines, const Visit& visit) {
    for (std::size_t axis = 0; axis < 3; ++axis)
      for (int a = 0; a <= lines; ++a)
        for (int b = 0; b <= lines; ++b)
          visit(Line{axis, static_cast<double>(a) / lines, static_cast<double>(b) / lines});
  }
  Eigen::Vector3d position_of(const Cell& cell, const Line& line, double t) const {
    return (X_PatientVoxel_ * Point<Voxel>(cell.first + Cell::on(line, t))).eigen();
  }
  void inspect_closely(const Cell& cell, const Eigen::Vector3d& x, double& best_mm) const {
    const auto distance_on = [&](const Line& line) {
      const auto t = cell.crossing(line);
      return t ? (position_of(cell, line, *t) - x).norm() : std::numeric_limits<double>::infinity();
    };
    Line nearest{0, 0, 0};
    double min_mm = std::numeric_limits<double>::infinity();
    for_lines(kManyLines, [&](const Line& line) {
      const double mm = distance_on(line);
      if (mm < min_mm) nearest = line, min_mm = mm;
    });
    // shifts the line with a decreasing step while the distance decreases
    for (double step = 0.5 / kManyLines; step > 1e-4;) {
      Line better = nearest;
      for (const auto& [du, dv] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
        const Line moved{nearest.axis, std::clamp(nearest.u + du * step, 0.0, 1.0),
                         std::clamp(nearest.v + dv * step, 0.0, 1.0)};
        const double mm = distance_on(moved);
        if (mm < min_mm) better = moved, min_mm = mm;
      }
      if (better.u == nearest.u && better.v == nearest.v) step *= 0.5;
      nearest = better;
    }
    best_mm = std::min(best_mm, min_mm);
  }

  Volume<std::int16_t> voxels_;
  SignedSteps steps_;
  Transform<Patient, Voxel> X_PatientVoxel_;
  std::vector<Cell> cells_;
  std::vector<Eigen::Vector3d> points_;
};

}  // namespace palpate::testing
