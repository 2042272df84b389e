#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <random>
#include <vector>

#include "contact/test_random.h"
#include "palpate/contact/proxy.h"
#include "palpate/contact/proxy_path.h"

/// Test surfaces with exactly known distances, and an oracle for the penetration of a proxy's path.
namespace palpate::testing {

using Distance = std::function<double(const Eigen::Vector3d&)>;

inline constexpr double kStep_mm = 1.0 / 2048;

/// Cubic voxel grid centred at the origin.
inline GridGeometry cube_grid(double half_extent_mm, const Eigen::Vector3d& spacing_mm,
                              const Eigen::Matrix3d& direction = Eigen::Matrix3d::Identity()) {
  GridGeometry grid;
  for (int axis = 0; axis < 3; ++axis)
    grid.dims[axis] = 2 * static_cast<int>(std::ceil(half_extent_mm / spacing_mm[axis])) + 1;
  grid.spacing_mm = spacing_mm;
  grid.direction = direction;
  const Eigen::Vector3d half(grid.dims[0] / 2, grid.dims[1] / 2, grid.dims[2] / 2);
  grid.origin = Point<Patient>(-(direction * half.cwiseProduct(spacing_mm)));
  return grid;
}

/// Distance field sampled at the voxels, in steps of 1/2048 mm, clamped to its reach.
inline SignedField sampled_distance(const GridGeometry& grid, const Distance& distance_mm, double reach_mm) {
  Volume<std::int16_t> volume(grid);
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) {
        const double d = distance_mm((X_PatientVoxel * Point<Voxel>(i, j, k)).eigen());
        volume.at(i, j, k) =
            static_cast<std::int16_t>(std::lround(std::clamp(d, -reach_mm, reach_mm) / kStep_mm));
      }
  return {volume, {kStep_mm, 0, static_cast<std::int16_t>(std::lround(reach_mm / kStep_mm))}};
}

/// Upper bound of the gradient's magnitude in any cell.
inline double steepest_of(const SignedField& field) {
  const auto& dims = field.geometry().dims;
  const Eigen::Vector3d& h = field.geometry().spacing_mm;
  const auto value = [&](int i, int j, int k) { return field.steps().scale * field.bricks().at(i, j, k); };
  // in a cell a partial derivative is bounded by the differences along its four edges
  double max_gradient = 1;
  for (int k = 0; k + 1 < dims[2]; ++k)
    for (int j = 0; j + 1 < dims[1]; ++j)
      for (int i = 0; i + 1 < dims[0]; ++i) {
        Eigen::Vector3d most = Eigen::Vector3d::Zero();
        for (int a = 0; a < 2; ++a)
          for (int b = 0; b < 2; ++b) {
            most[0] = std::max(most[0], std::abs(value(i + 1, j + a, k + b) - value(i, j + a, k + b)) / h[0]);
            most[1] = std::max(most[1], std::abs(value(i + a, j + 1, k + b) - value(i + a, j, k + b)) / h[1]);
            most[2] = std::max(most[2], std::abs(value(i + a, j + b, k + 1) - value(i + a, j + b, k)) / h[2]);
          }
        max_gradient = std::max(max_gradient, most.norm());
      }
  return max_gradient;
}

inline ContactSurface make_contact_surface(const GridGeometry& grid, const Distance& distance_mm,
                                           double reach_mm = 6) {
  const SignedField field = sampled_distance(grid, distance_mm, reach_mm);
  ContactSurface surface;
  surface.surface = std::make_shared<const Surface>(field, field, steepest_of(field));
  surface.set_friction(0);
  return surface;
}

/// A tool moved through a sequence of poses, and the results of its proxy.
struct ProxyRun {
  std::vector<ContactSurface> surfaces;
  std::vector<ToolPart> parts{ToolPart{}};  ///< tool parts with the identity attitude
  ProxyState state;
  ProxyResult result;
  double dt_s = 0.001;
  const ComplianceFrame* compliance = nullptr;
  const RelaxationTimes* relaxation_times = nullptr;
  Holes holes;
  /// Maximum penetration at any point of any path, sampled every 0.01 mm; positive: below the surface.
  double deepest_mm = 0;

  const ProxyResult& at(const Point<Patient>& tip,
                        const Eigen::Quaterniond& attitude = Eigen::Quaterniond::Identity()) {
    const ToolPose hand(tip, attitude);
    ProxyPath path;
    const ProxyState before = state;
    result = advance_proxy(
        surfaces, turned(hand.attitude).parts(), hand, state,
        {.dt_s = dt_s, .compliance = compliance, .relaxation_times = relaxation_times, .holes = &holes},
        &path);
    // a released proxy is reset to the tip
    const bool let_go =
        before.contact_count > 0 && state.contact_count == 0 && result.release.force_N != Vector<Patient>();
    if (before.coupled && path.count > 0 && !let_go)
      scan_along({before.position, before.attitude}, {path.vertices[0], path.attitudes[0]});
    for (std::size_t n = 1; n < path.count; ++n)
      scan_along({path.vertices[n - 1], path.attitudes[n - 1]}, {path.vertices[n], path.attitudes[n]});
    if (state.coupled && !result.wedged)
      scan_along({state.position, state.attitude}, {state.position, state.attitude});
    return result;
  }

  /// Moves the tip along a line in equal steps.
  void lead(const Point<Patient>& from, const Point<Patient>& to, double step_mm) {
    const int steps = std::max(1, static_cast<int>(std::ceil((to - from).norm() / step_mm)));
    for (int n = 1; n <= steps; ++n) at(from + (to - from) * (static_cast<double>(n) / steps));
  }

  /// Tool parts in an attitude.
  RotatedTool turned(const Eigen::Quaterniond& attitude) const {
    return {parts, Eigen::Quaterniond::Identity(), attitude};
  }

 private:
  void scan_along(const ToolPose& a, const ToolPose& b) {
    constexpr double kEvery_mm = 0.01;
    double farthest_mm = 0;
    for (const ToolPart& part : parts)
      farthest_mm = std::max({farthest_mm, part.offset_mm.norm(), (part.offset_mm + part.axis_mm).norm()});
    const double path_mm = (b.tip - a.tip).norm() + farthest_mm * a.attitude.angularDistance(b.attitude);
    const int pieces = static_cast<int>(path_mm / kEvery_mm) + 1;
    for (int n = 0; n <= pieces;) {
      const double part = static_cast<double>(n) / pieces;
      const Point<Patient> p = a.tip + (b.tip - a.tip) * part;
      const bool turns = a.attitude.coeffs() != b.attitude.coeffs();
      const RotatedTool tool = turned(turns ? a.attitude.slerp(part, b.attitude) : a.attitude);
      // distance that the whole tool may move without exceeding the deepest penetration so far
      double free_mm = 1e3;
      for (std::size_t s = 0; s < surfaces.size(); ++s) {
        // the path is that of the outermost proxy
        if (surfaces[s].surface == nullptr || surfaces[s].layer > 0) continue;
        const int outer = surfaces[s].covered_by;
        const bool covered = outer >= 0 && !state.punctured[static_cast<std::size_t>(outer)];
        if (state.punctured[s] || covered) continue;
        for (const ToolPart& part : tool.parts())
          free_mm = std::min(free_mm, scan_row(*surfaces[s].surface, p, part));
      }
      n += std::max(1, static_cast<int>(free_mm / kEvery_mm));
    }
  }

  /// Checks a capsule's outline, not its row of spheres, every 0.1 mm where it may exceed the deepest
  /// penetration so far.
  /// @returns distance in mm that it may move without exceeding it
  double scan_row(const Surface& surface, const Point<Patient>& tip, const ToolPart& part) {
    constexpr double kAlong_mm = 0.1;
    const double length_mm = part.axis_mm.norm();
    const int count = length_mm > 0 ? static_cast<int>(length_mm / kAlong_mm) + 1 : 0;
    double free_mm = 1e3;
    for (int index = 0; index <= count;) {
      const double fraction = count > 0 ? static_cast<double>(index) / count : 0;
      const double outside_mm =
          surface.distance_mm(tip + part.offset_mm + part.axis_mm * fraction) - part.radius_mm;
      deepest_mm = std::max(deepest_mm, -outside_mm);
      const double its_mm = (outside_mm + deepest_mm) / (1.001 * surface.max_gradient());
      free_mm = std::min(free_mm, its_mm);
      index += std::max(1, static_cast<int>(its_mm / kAlong_mm));
    }
    return free_mm;
  }
};

}  // namespace palpate::testing
