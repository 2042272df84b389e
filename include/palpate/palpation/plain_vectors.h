#pragma once

#include <Eigen/Geometry>
#include <array>

/// Conversions from the plain arrays of ticks and requests.
namespace palpate {

inline Eigen::Quaterniond quaternion(const std::array<double, 4>& wxyz) {
  return Eigen::Quaterniond(wxyz[0], wxyz[1], wxyz[2], wxyz[3]);
}

inline double norm(const std::array<double, 3>& v) {
  return Eigen::Vector3d(v[0], v[1], v[2]).norm();
}

}  // namespace palpate
