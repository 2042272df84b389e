#pragma once

#include <random>

#include "palpate/geometry.h"

namespace palpate::testing {

/// Evenly over the sphere, of length 1.
inline Vector<Patient> random_direction(std::mt19937& random) {
  std::normal_distribution<double> normal;
  return Vector<Patient>(normal(random), normal(random), normal(random)).normalized();
}

}  // namespace palpate::testing
