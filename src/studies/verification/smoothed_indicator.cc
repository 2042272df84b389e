#include "verification/smoothed_indicator.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "verification/gauss_legendre.h"

namespace palpate {
namespace {

constexpr double kReach = 7.5;  // in units of sigma; beyond, the density of a Gaussian is below 1e-13
constexpr int kIndicatorNodes = 48;

template <class Integrand>
double integrate(double from, double to, const Integrand& f) {
  static const GaussLegendre<kIndicatorNodes> quadrature;
  const double midpoint = 0.5 * (from + to), half = 0.5 * (to - from);
  double sum = 0;
  for (std::size_t i = 0; i < kIndicatorNodes; ++i)
    sum += quadrature.weight[i] * f(midpoint + half * quadrature.node[i]);
  return half * sum;
}

double gaussian(double x, double sigma) {
  return std::exp(-0.5 * x * x / (sigma * sigma)) / (sigma * std::sqrt(2 * std::numbers::pi));
}

// Integral over |x| < radius of gaussian(x - at) * section(sqrt(radius^2 - x^2)). The substitution x = radius
// sin(t) removes the singularity of the square root.
template <class Section>
double integrate_chords(double at, double radius, double sigma, const Section& section) {
  const auto angle = [&](double x) { return std::asin(std::clamp(x / radius, -1.0, 1.0)); };
  return integrate(angle(at - kReach * sigma), angle(at + kReach * sigma), [&](double t) {
    const double x = radius * std::sin(t), half_chord = radius * std::cos(t);
    return half_chord * gaussian(x - at, sigma) * section(half_chord);
  });
}

}  // namespace

double smoothed_half_space(double distance, double sigma) {
  return 0.5 * std::erfc(distance / (sigma * std::numbers::sqrt2));
}

double smoothed_ball(double r, double radius, double sigma) {
  const double scale = 1 / (sigma * std::numbers::sqrt2);
  // the general form is 0 / 0 near the centre
  if (r < 1e-4 * sigma) {
    return std::erf(radius * scale) - 2 * radius * gaussian(radius, sigma);
  }
  const double inside = 0.5 * (std::erf((radius - r) * scale) + std::erf((radius + r) * scale));
  return inside - sigma * sigma / r * (gaussian(radius - r, sigma) - gaussian(radius + r, sigma));
}

double smoothed_disc(double rho, double radius, double sigma) {
  return integrate_chords(rho, radius, sigma, [&](double half_chord) {
    return std::erf(half_chord / (sigma * std::numbers::sqrt2));
  });
}

double smoothed_torus(double rho, double z, double major_radius, double minor_radius, double sigma) {
  // the section at each height is an annulus
  return integrate_chords(z, minor_radius, sigma, [&](double half_width) {
    return smoothed_disc(rho, major_radius + half_width, sigma) -
           smoothed_disc(rho, major_radius - half_width, sigma);
  });
}

}  // namespace palpate
