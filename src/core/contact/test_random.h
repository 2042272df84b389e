#pragma once

#include <random>

#include "palpate/geometry/geometry.h"

namespace palpate::testing {

/// Unit vector, uniformly distributed on the sphere.
inline Vector<Patient> random_direction(std::mt19937& random) {
  std::normal_distribution<double> normal;
  // drawn in separate statements, because the order in which arguments are evaluated is unspecified
  const double z = normal(random), y = normal(random), x = normal(random);
  return Vector<Patient>(x, y, z).normalized();
}

}  // namespace palpate::testing
