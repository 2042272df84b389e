#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>

namespace palpate {

/// Random numbers that are identical with every standard library, unlike those of its distributions.
class AccuracyRandom {
 public:
  explicit AccuracyRandom(std::uint64_t seed) : engine_(seed) {}
  double between(double low, double high) {
    return low + (high - low) * (static_cast<double>(engine_() >> 11) * 0x1.0p-53);
  }
  Eigen::Vector3d direction() {
    const double z = between(-1, 1), azimuth = between(0, 2 * std::numbers::pi);
    const double r = std::sqrt(1 - z * z);
    return {r * std::cos(azimuth), r * std::sin(azimuth), z};
  }

 private:
  std::mt19937_64 engine_;
};

}  // namespace palpate
