#pragma once

#include <algorithm>
#include <cmath>
#include <functional>

#include "contact/test_proxy_surfaces.h"
#include "palpate/contact/proxy.h"

/// A proxy above a floor, and what else the tests of proxies share.
namespace palpate::testing {

inline constexpr unsigned kProxySeed = 51;
inline const Eigen::Vector3d kKnee_mm(0.277, 0.277, 1.0);

/// Half-space below z = 0.
inline double floor_mm(const Eigen::Vector3d& p) {
  return p.z();
}

inline ProxyRun on_floor(double friction_static = 0, double friction_dynamic = 0, double stiffness = 2) {
  ProxyRun run;
  run.surfaces = {make_contact_surface(cube_grid(10, {0.5, 0.5, 0.5}), floor_mm)};
  run.surfaces[0].stiffness_N_per_mm = stiffness;
  run.surfaces[0].static_friction = friction_static;
  run.surfaces[0].friction = friction_dynamic;
  run.at({0, 0, 3});
  return run;
}

/// Labels by position, as voxels.
inline Bricks<LabelId> labelled(const GridGeometry& grid,
                                const std::function<LabelId(const Eigen::Vector3d&)>& label_at) {
  Volume<LabelId> labels(grid);
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i)
        labels.at(i, j, k) = label_at((grid.X_PatientVoxel() * Point<Voxel>(i, j, k)).eigen());
  return *label_bricks(labels);
}

/// Maximum change of force per tick beyond that explained by the displacement, on a path in steps.
inline double largest_change_N(ProxyRun& run, const Point<Patient>& from, const Point<Patient>& to,
                               double step_mm) {
  double largest_N = 0;
  const int steps = static_cast<int>(std::lround((to - from).norm() / step_mm));
  for (int n = 1; n <= steps; ++n) {
    const ProxyResult before = run.result;
    run.at(from + (to - from) * (static_cast<double>(n) / steps));
    const double non_slip_change_N =
        std::max(before.stiffness_N_per_mm, run.result.stiffness_N_per_mm) * step_mm;
    largest_N = std::max(largest_N, (run.result.force_N - before.force_N).norm() - non_slip_change_N);
  }
  return largest_N;
}

}  // namespace palpate::testing
