#pragma once

#include <Eigen/Geometry>
#include <random>

/// Random numbers for the tests of navigation.
namespace palpate::test {

inline Eigen::Vector3d normal(std::mt19937& random) {
  std::normal_distribution<double> one;
  const double x = one(random), y = one(random), z = one(random);
  return {x, y, z};
}
/// Uniformly distributed rotation.
inline Eigen::Quaterniond any_rotation(std::mt19937& random) {
  std::normal_distribution<double> one;
  const double w = one(random);
  const Eigen::Vector3d v = normal(random);
  return Eigen::Quaterniond(w, v.x(), v.y(), v.z()).normalized();
}

}  // namespace palpate::test
