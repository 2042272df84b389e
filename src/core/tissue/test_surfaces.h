#pragma once

#include <memory>

#include "contact/test_proxy_surfaces.h"

/// Surfaces to carve, for tests.
namespace palpate::testing {

inline constexpr double kCarvedReach_mm = 4;

/// Surface with a separate normal grid, as preparation produces it.
inline std::shared_ptr<const Surface> surface_to_carve(
    double half_mm, const Eigen::Vector3d& spacing_mm, const Distance& distance_mm,
    const Eigen::Matrix3d& direction = Eigen::Matrix3d::Identity()) {
  const auto sampled = [&](const Eigen::Vector3d& spacing) {
    return sampled_distance(cube_grid(half_mm, spacing, direction), distance_mm, kCarvedReach_mm);
  };
  return std::make_shared<const Surface>(sampled(spacing_mm), sampled(spacing_mm.cwiseMax(0.6)), 1.05);
}

/// Slab between two heights, with sides far from the centre: a slightly larger grid contains all of it.
inline Distance slab(double low_mm, double high_mm, double half_mm) {
  const Eigen::Vector3d centre(0, 0, 0.5 * (low_mm + high_mm));
  const Eigen::Vector3d half(half_mm, half_mm, 0.5 * (high_mm - low_mm));
  return [=](const Eigen::Vector3d& p) {
    const Eigen::Vector3d off = (p - centre).cwiseAbs() - half;
    return off.cwiseMax(0).norm() + std::min(0.0, off.maxCoeff());
  };
}

inline Eigen::Matrix3d turned_by(double radians) {
  return Eigen::AngleAxisd(radians, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
}

}  // namespace palpate::testing
