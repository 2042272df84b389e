#pragma once

#include <random>

#include "palpate/geometry/geometry.h"

namespace palpate::testing {

/// Evenly over the sphere, of length 1.
inline Vector<Patient> random_direction(std::mt19937& random) {
  std::normal_distribution<double> normal;
  // drawn one by one: arguments are evaluated in no certain order
  const double z = normal(random), y = normal(random), x = normal(random);
  return Vector<Patient>(x, y, z).normalized();
}

}  // namespace palpate::testing
