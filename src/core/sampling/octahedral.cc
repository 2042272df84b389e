#include "sampling/octahedral.h"

#include <algorithm>
#include <cmath>

namespace palpate::internal {

OctahedralCode encode_octahedral(const Eigen::Vector3d& n, int levels) {
  Eigen::Vector2d position = n.head<2>() / n.lpNorm<1>();
  if (n.z() < 0) {
    const Eigen::Vector2d upper = position;
    position[0] = std::copysign(1 - std::abs(upper[1]), upper[0]);
    position[1] = std::copysign(1 - std::abs(upper[0]), upper[1]);
  }

  const int a = static_cast<int>(std::floor(position[0] * levels)),
            b = static_cast<int>(std::floor(position[1] * levels));
  OctahedralCode best;
  double best_cosine = -2;
  for (int corner = 0; corner < 4; ++corner) {
    const OctahedralCode code{std::min(a + (corner & 1), levels), std::min(b + (corner >> 1), levels)};
    const double cosine = decode_octahedral(code, levels).dot(n);
    if (cosine > best_cosine) {
      best_cosine = cosine;
      best = code;
    }
  }
  return best;
}

Eigen::Vector3d decode_octahedral(const OctahedralCode& code, int levels) {
  const double x = static_cast<double>(code.a) / levels, y = static_cast<double>(code.b) / levels;
  const double z = 1 - std::abs(x) - std::abs(y);
  // unfolds the lower hemisphere
  const double fold = std::max(-z, 0.0);
  return Eigen::Vector3d(x - std::copysign(fold, x), y - std::copysign(fold, y), z).normalized();
}

}  // namespace palpate::internal
