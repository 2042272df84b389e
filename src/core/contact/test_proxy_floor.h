#pragma once

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

}  // namespace palpate::testing
