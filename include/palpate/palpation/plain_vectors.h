#pragma once

#include <Eigen/Geometry>
#include <array>

/// Numbers of a tick or a request as what is reckoned with.
namespace palpate {

inline Eigen::Quaterniond quaternion(const std::array<double, 4>& wxyz) {
  return Eigen::Quaterniond(wxyz[0], wxyz[1], wxyz[2], wxyz[3]);
}

inline double norm(const std::array<double, 3>& v) {
  return Eigen::Vector3d(v[0], v[1], v[2]).norm();
}

}  // namespace palpate
