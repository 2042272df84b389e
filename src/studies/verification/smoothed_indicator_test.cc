#include "verification/smoothed_indicator.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <functional>
#include <numbers>
#include <utility>
#include <vector>

namespace palpate {
namespace {

using Eigen::Vector3d;

double weight(double x, double sigma) {
  return std::exp(-0.5 * x * x / (sigma * sigma)) / (sigma * std::sqrt(2 * std::numbers::pi));
}

// Slow, independent reference: sums Gaussian weights over a fine lattice of points inside a solid. Along z
// the sum is replaced by the exact integral between the solid's crossings.
double lattice_sum(
    const Vector3d& p, double sigma,
    const std::function<std::vector<std::pair<double, double>>(double x, double y)>& crossings) {
  const double step = 0.05 * sigma, reach = 7 * sigma;
  double sum = 0;
  for (double x = -reach; x <= reach; x += step) {
    for (double y = -reach; y <= reach; y += step) {
      for (const auto& [low, high] : crossings(p.x() + x, p.y() + y)) {
        const double inside = 0.5 * (std::erf((high - p.z()) / (sigma * std::numbers::sqrt2)) -
                                     std::erf((low - p.z()) / (sigma * std::numbers::sqrt2)));
        sum += step * step * weight(x, sigma) * weight(y, sigma) * inside;
      }
    }
  }
  return sum;
}

// Series of the disc: a Poisson-distributed number of radial steps, then an incomplete gamma function.
double disc_series(double rho, double radius, double sigma) {
  const double a = 0.5 * rho * rho / (sigma * sigma), x = 0.5 * radius * radius / (sigma * sigma);
  double poisson = std::exp(-a), power = std::exp(-x), tail = power, sum = 0;
  for (int k = 0; k < 2000; ++k) {
    sum += poisson * (1 - tail);
    poisson *= a / (k + 1);
    power *= x / (k + 1);
    tail += power;
  }
  return sum;
}

TEST(SmoothedIndicator, HalfSpaceIsTheNormalDistribution) {
  EXPECT_DOUBLE_EQ(smoothed_half_space(0, 1.5), 0.5);
  EXPECT_NEAR(smoothed_half_space(-1.5, 1.5), 0.8413447460685429, 1e-15);
  EXPECT_NEAR(smoothed_half_space(3, 1.5), 0.02275013194817921, 1e-15);
  const double slope = (smoothed_half_space(1e-5, 1.5) - smoothed_half_space(-1e-5, 1.5)) / 2e-5;
  EXPECT_NEAR(slope, -1 / (1.5 * std::sqrt(2 * std::numbers::pi)), 1e-9);
}

TEST(SmoothedIndicator, BallEqualsASumOverItsPoints) {
  const double radius = 4, sigma = 1.2;
  const auto ball = [&](double x, double y) {
    const double rest = radius * radius - x * x - y * y;
    return rest <= 0 ? std::vector<std::pair<double, double>>{}
                     : std::vector{std::pair{-std::sqrt(rest), std::sqrt(rest)}};
  };
  for (const double r : {0.0, 1e-6, 0.5, 3.0, 4.0, 5.5}) {
    const Vector3d p = r * Vector3d(0.48, 0.6, 0.64);
    EXPECT_NEAR(smoothed_ball(r, radius, sigma), lattice_sum(p, sigma, ball), 2e-5) << r;
  }
}

TEST(SmoothedIndicator, BallIsContinuousAtTheCentre) {
  EXPECT_NEAR(smoothed_ball(1.01e-4, 2, 1), smoothed_ball(0.99e-4, 2, 1), 1e-8);
}

TEST(SmoothedIndicator, DiscEqualsItsSeries) {
  for (const auto& [radius, sigma] : {std::pair{10.0, 1.5}, {10.0, 1.0}, {4.0, 1.2}, {1.0, 3.0}}) {
    for (const double rho : {0.0, 0.7, 3.5, 4.0, 9.3, 10.0, 10.7}) {
      EXPECT_NEAR(smoothed_disc(rho, radius, sigma), disc_series(rho, radius, sigma), 1e-9)
          << rho << ", " << radius;
    }
  }
}

TEST(SmoothedIndicator, TorusEqualsASumOfRings) {
  const double major = 20, minor = 8, sigma = 1.5;
  const auto rings = [&](double rho, double z) {
    const int count = 4000;
    double sum = 0;
    for (int n = 0; n < count; ++n) {
      const double t = std::numbers::pi * ((n + 0.5) / count - 0.5);
      const double height = minor * std::sin(t), half_width = minor * std::cos(t);
      const double ring =
          disc_series(rho, major + half_width, sigma) - disc_series(rho, major - half_width, sigma);
      sum += std::numbers::pi / count * half_width * weight(height - z, sigma) * ring;
    }
    return sum;
  };
  for (const auto& [rho, z] : {std::pair{28.0, 0.0}, {12.5, 0.0}, {20.0, 8.3}, {25.0, 6.0}}) {
    EXPECT_NEAR(smoothed_torus(rho, z, major, minor, sigma), rings(rho, z), 1e-7) << rho << ", " << z;
  }
}

TEST(SmoothedIndicator, TorusEqualsASumOverItsPoints) {
  const double major = 6, minor = 2.5, sigma = 1.1;
  const auto torus = [&](double x, double y) {
    const double rest = minor * minor - std::pow(std::hypot(x, y) - major, 2);
    return rest <= 0 ? std::vector<std::pair<double, double>>{}
                     : std::vector{std::pair{-std::sqrt(rest), std::sqrt(rest)}};
  };
  // error of the lattice itself at the rim
  for (const auto& [rho, z] :
       {std::pair{8.5, 0.0}, {3.5, 0.0}, {6.0, 2.5}, {7.5, 1.5}, {0.0, 0.0}, {6.0, 0.0}}) {
    EXPECT_NEAR(smoothed_torus(rho, z, major, minor, sigma),
                lattice_sum({0.8 * rho, 0.6 * rho, z}, sigma, torus), 1e-4)
        << rho << ", " << z;
  }
}

TEST(SmoothedIndicator, LargeShapesBecomeHalfSpaces) {
  for (const double d : {-1.0, -0.2, 0.0, 0.6, 2.0}) {
    const double flat = smoothed_half_space(d, 1.5);
    EXPECT_NEAR(smoothed_ball(2e4 + d, 2e4, 1.5), flat, 1e-4);
    EXPECT_NEAR(smoothed_disc(2e4 + d, 2e4, 1.5), flat, 1e-4);
    EXPECT_NEAR(smoothed_torus(3e4 + d, 0, 2e4, 1e4, 1.5), flat, 2e-4);
  }
}

// First order in curvature: on a surface of mean curvature H the value differs from 1/2 by sigma H / sqrt(2
// pi).
TEST(SmoothedIndicator, CurvatureLowersTheValueOnTheSurface) {
  const double sigma = 0.5, factor = sigma / std::sqrt(2 * std::numbers::pi);
  EXPECT_NEAR(smoothed_ball(20, 20, sigma), 0.5 - factor / 20, 1e-5);
  EXPECT_NEAR(smoothed_disc(20, 20, sigma), 0.5 - factor / 40, 1e-5);
}

}  // namespace
}  // namespace palpate
