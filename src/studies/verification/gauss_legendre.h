#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace palpate {

/// Gauss-Legendre nodes and weights on [-1, 1], by Newton's method on the Legendre polynomial.
template <int kNodes>
struct GaussLegendre {
  std::array<double, kNodes> node{}, weight{};

  GaussLegendre() {
    for (int i = 0; i < kNodes; ++i) {
      double x = std::cos(std::numbers::pi * (i + 0.75) / (kNodes + 0.5));
      double slope = 1;
      for (int step = 0; step < 8; ++step) {
        double before = 1, here = x;
        for (int degree = 2; degree <= kNodes; ++degree) {
          const double next = ((2 * degree - 1) * x * here - (degree - 1) * before) / degree;
          before = here;
          here = next;
        }
        slope = kNodes * (x * here - before) / (x * x - 1);
        x -= here / slope;
      }
      const auto n = static_cast<std::size_t>(i);
      node[n] = x;
      weight[n] = 2 / ((1 - x * x) * slope * slope);
    }
  }
};

}  // namespace palpate
