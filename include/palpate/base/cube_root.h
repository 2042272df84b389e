#pragma once

#include <bit>
#include <cstdint>

namespace palpate {

/// Cube root, bit-identical on every machine, which std::cbrt does not guarantee. Relative error about 1e-15.
/// @param x  finite, at least 1e-290; 0 gives 0
inline double cube_root(double x) {
  if (!(x > 0)) return 0;
  // Initial guess with a third of the exponent, accurate to some per cent (Kahan 1991), then Newton's method.
  constexpr std::uint64_t kThirdOfBias = 0x2a9f789300000000ull;
  double root = std::bit_cast<double>(std::bit_cast<std::uint64_t>(x) / 3 + kThirdOfBias);
  for (int n = 0; n < 4; ++n) root -= (root - x / (root * root)) / 3;
  return root;
}

}  // namespace palpate
