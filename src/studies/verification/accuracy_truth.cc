#include "verification/accuracy_truth.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

#include "verification/gauss_legendre.h"

namespace palpate {
namespace {

constexpr double kGaussianReach = 5.5;  // in units of sigma; the tail beyond is less than 4e-8 of a Gaussian
constexpr int kNodes = 20;

// Root of the distance on a line segment whose ends have different signs, by the Illinois variant of false
// position.
template <class Distance>
double crossing(const Distance& distance, double a, double at_a, double b, double at_b) {
  double x = a;
  for (int step = 0; step < 20; ++step) {
    x = (a * at_b - b * at_a) / (at_b - at_a);
    const double at_x = distance(x);
    if (std::abs(at_x) < 1e-7) break;
    if ((at_x < 0) == (at_b < 0)) {
      at_a *= 0.5;
    } else {
      a = b;
      at_a = at_b;
    }
    b = x;
    at_b = at_x;
  }
  return x;
}

// Integral of the weight over the part of the line inside the solid.
template <class Distance>
double weight_inside(const Distance& distance, const AxisWeight& weight) {
  const double reach = weight.reach_mm(), min_step = reach / 256;
  double sum = 0, x = -reach, at_x = distance(x);
  while (x < reach) {
    // sphere tracing: there is no crossing within the distance
    const double next = std::min(x + std::max(std::abs(at_x), min_step), reach), at_next = distance(next);
    if ((at_x < 0) != (at_next < 0)) {
      const double passed = weight.integral(crossing(distance, x, at_x, next, at_next));
      sum += at_x < 0 ? passed : -passed;
    }
    x = next;
    at_x = at_next;
  }
  return sum + (at_x < 0 ? 1 : 0);
}

}  // namespace

AxisWeight AxisWeight::gaussian(double sigma_mm) {
  return {kGaussianReach * sigma_mm, sigma_mm};
}

AxisWeight AxisWeight::compact(double radius_mm) {
  return {radius_mm, 0};
}

double AxisWeight::density(double x_mm) const {
  if (std::abs(x_mm) >= reach_mm_) return 0;
  if (sigma_mm_ > 0)
    return std::exp(-0.5 * x_mm * x_mm / (sigma_mm_ * sigma_mm_)) /
           (sigma_mm_ * std::sqrt(2 * std::numbers::pi));
  const double u = x_mm / reach_mm_, rest = 1 - u * u;
  return 35.0 / 32 / reach_mm_ * rest * rest * rest;
}

double AxisWeight::integral(double x_mm) const {
  if (x_mm <= -reach_mm_) return 0;
  if (x_mm >= reach_mm_) return 1;
  if (sigma_mm_ > 0) return 0.5 * std::erfc(-x_mm / (sigma_mm_ * std::numbers::sqrt2));
  const double u = x_mm / reach_mm_, u2 = u * u;
  return 0.5 + 35.0 / 32 * u * (1 + u2 * (-1 + u2 * (0.6 - u2 / 7)));
}

double smoothed_solid(const Shape& shape, const Point<Patient>& p, const std::array<AxisWeight, 3>& weights) {
  static const GaussLegendre<kNodes> quadrature;
  Eigen::Index along = 0;
  shape.normal(p).eigen().cwiseAbs().maxCoeff(&along);
  const Eigen::Index lateral = (along + 1) % 3, across = (along + 2) % 3;
  const auto weight_of = [&](Eigen::Index axis) { return weights[static_cast<std::size_t>(axis)]; };
  const AxisWeight w_along = weight_of(along), w_lateral = weight_of(lateral), w_across = weight_of(across);

  // quadrature over the lines
  double sum = 0;
  for (std::size_t i = 0; i < kNodes; ++i) {
    for (std::size_t j = 0; j < kNodes; ++j) {
      Eigen::Vector3d offset = Eigen::Vector3d::Zero();
      offset[lateral] = w_lateral.reach_mm() * quadrature.node[i];
      offset[across] = w_across.reach_mm() * quadrature.node[j];
      const auto distance = [&](double x) {
        offset[along] = x;
        return shape.distance_mm(p + Vector<Patient>(offset));
      };
      sum += quadrature.weight[i] * w_lateral.reach_mm() * w_lateral.density(offset[lateral]) *
             quadrature.weight[j] * w_across.reach_mm() * w_across.density(offset[across]) *
             weight_inside(distance, w_along);
    }
  }
  return sum;
}

}  // namespace palpate
