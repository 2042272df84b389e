#include "verification/accuracy.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <array>
#include <atomic>
#include <cmath>
#include <map>
#include <string_view>
#include <utility>

#include "palpate/base/force_method.h"
#include "verification/accuracy_bench.h"

// The original voxel size with every shape, and the plane on all three spacings; accuracy_gate_test.cc runs
// the whole suite.
namespace palpate {
namespace {

const std::map<std::string, Figure>& figures() {
  static const std::map<std::string, Figure> all = [] {
    std::map<std::string, Figure> found;
    for (const AccuracyCase& shape : accuracy_cases(4000)) {
      const ShapeTruth truth(shape);
      for (const AccuracySpacing& spacing : accuracy_spacings()) {
        if (spacing.name != "0.625x0.625x0.9" && shape.name != "tilted-plane") continue;
        const auto measured = measure_on_grid(truth, shape.name + "/" + spacing.name, spacing.mm, {});
        for (const Figure& figure : measured.value()) found[figure.name] = figure;
      }
    }
    return found;
  }();
  return all;
}

double value(const std::string& name) {
  const auto found = figures().find(name);
  if (found != figures().end()) return found->second.value;
  ADD_FAILURE() << "no figure " << name;
  return std::nan("");
}

constexpr const char* kShapes[] = {"sphere-20mm", "cylinder-10mm", "tilted-plane", "torus-20-8mm"};

std::string founding(const std::string& method, const std::string& shape, const std::string& rest) {
  return method + "/" + shape + "/0.625x0.625x0.9/" + rest;
}

void expect_every_method_measured() {
  for (const char* shape : kShapes) {
    for (const ForceMethodInfo& info : kDirectMethods) {
      for (const char* leaf : {"direction/mean", "direction/p99", "direction/max", "magnitude/mean",
                               "magnitude/p99", "magnitude/max"})
        EXPECT_LT(value(founding(std::string(info.name), shape, leaf)), 50);
      if (info.method != ForceMethod::kGaussianSphere)
        value(founding(std::string(info.name), shape, "sigma-1.0/direction/mean"));
    }
  }
  for (const char* shape : {"sphere-20mm", "torus-20-8mm"})
    for (const char* method : {"trilinear", "trilinear-u8", "b-spline", "b-spline-u8", "gaussian-sphere",
                               "gaussian-sphere-sigma-2", "smooth-sphere", "stored-normals",
                               "stored-normals-oct16", "stored-normals-oct24"})
      EXPECT_LE(value(founding(method, shape, "choppiness/p99")),
                value(founding(method, shape, "choppiness/max")));
}

void expect_limits_met() {
  for (const auto& [name, figure] : figures())
    EXPECT_TRUE(figure.ok()) << name << " " << figure.value << " > " << figure.limit.value_or(0);
}

// Requirements of the project, independent of the measured values.
void expect_limits_as_requested() {
  const std::string exact = founding("b-spline-exact-int16", "sphere-20mm", "direction/");
  EXPECT_LE(accuracy_limit(exact + "mean").value(), 0.05);
  EXPECT_LE(accuracy_limit(exact + "p99").value(), 0.2);
  for (const char* method : {"smooth-sphere", "b-spline"})
    for (const char* shape : {"sphere-20mm", "torus-20-8mm"})
      for (const AccuracySpacing& spacing : accuracy_spacings())
        EXPECT_LE(accuracy_limit(std::string(method) + "/" + shape + "/" + spacing.name + "/choppiness/p99")
                      .value(),
                  1);
}

// A difference over +-h reduces the gradient along axis i to the profile's mean slope over h n_i, so unequal
// spacings rotate it. On exact samples of a plane this is the only error, and it is largest at the surface.
double turned_by_differences_deg(const Eigen::Vector3d& spacing, double sigma) {
  const Eigen::Vector3d n(0.36, 0.48, 0.8);
  Eigen::Vector3d gradient;
  for (int a = 0; a < 3; ++a) {
    gradient[a] = std::erf(spacing[a] * n[a] / (sigma * std::sqrt(2.0))) / (2 * spacing[a]);
  }
  return std::acos(gradient.normalized().dot(n)) * 180 / std::acos(-1.0);
}

void expect_exact_plane_turned_by_differences_alone() {
  for (const AccuracySpacing& spacing : accuracy_spacings())
    EXPECT_NEAR(value("trilinear-exact-u16/tilted-plane/" + spacing.name + "/direction/max") /
                    turned_by_differences_deg(spacing.mm, 1.5),
                1, 0.12)
        << spacing.name;
}

void expect_exact_plane_errs_by_interpolation_alone() {
  // at most h^2 / 8 times the second derivative of the profile, which is at most 0.242 / sigma^2, plus half a
  // quantisation step
  const double largest = 100 * (0.242 / (1.5 * 1.5) * 0.3 * 0.3 / 8 + 0.5 / 65535);
  EXPECT_LT(value("trilinear-exact-u16/tilted-plane/0.3x0.3x0.3/magnitude/max"), largest);
  EXPECT_GT(value("trilinear-exact-u16/tilted-plane/0.3x0.3x0.3/magnitude/max"), 0.5 * largest);
}

// On a plane the interpolant of exact distances is exact: the remaining error is half a quantisation step, in
// micrometres.
void expect_exact_distances_of_a_plane_off_by_half_a_step() {
  for (const AccuracySpacing& spacing : accuracy_spacings())
    EXPECT_LE(value("trilinear-exact-distance-int16/tilted-plane/" + spacing.name + "/distance/max"), 0.26);
}

// The error of stored normals is dominated by the interpolation weights, voxelised or not.
void expect_exact_samples_better_than_voxelised() {
  for (const char* shape : {"sphere-20mm", "cylinder-10mm", "torus-20-8mm"}) {
    for (const char* method : {"trilinear", "b-spline", "stored-normals"}) {
      for (const char* leaf : {"direction/mean", "direction/p99", "magnitude/mean"}) {
        const bool own_weights =
            std::string_view(method) == "stored-normals" && std::string_view(leaf) == "magnitude/mean";
        if (own_weights) continue;
        EXPECT_LT(value(founding(std::string(method) + "-exact-u16", shape, leaf)),
                  value(founding(method, shape, leaf)))
            << method << shape << leaf;
      }
    }
  }
}

void expect_more_bits_better() {
  for (const char* shape : kShapes) {
    for (const auto& [coarse, fine] : {std::pair{"trilinear-exact-u8", "trilinear-exact-u16"},
                                       {"b-spline-exact-u8", "b-spline-exact-u16"},
                                       {"b-spline-exact-u8", "b-spline-exact-int16"},
                                       {"trilinear-u8", "trilinear"},
                                       {"b-spline-u8", "b-spline"},
                                       {"stored-normals-oct16", "stored-normals-oct24"}}) {
      // on a flat side normals that differ by tenths of a degree average out
      if (std::string_view(coarse) == "stored-normals-oct16" && std::string_view(shape) == "tilted-plane")
        continue;
      EXPECT_GT(value(founding(coarse, shape, "direction/mean")),
                value(founding(fine, shape, "direction/mean")))
          << coarse << shape;
    }
  }
}

// The analytic gradient is not flattened by finite differences.
void expect_spline_better_than_differences() {
  for (const char* shape : kShapes)
    EXPECT_LT(value(founding("b-spline-exact-int16", shape, "direction/mean")),
              0.1 * value(founding("trilinear-exact-u16", shape, "direction/mean")))
        << shape;
}

void expect_narrower_worse() {
  for (const char* shape : kShapes)
    for (const char* method : {"trilinear", "b-spline", "smooth-sphere"})
      EXPECT_GT(value(founding(method, shape, "sigma-1.0/direction/mean")),
                value(founding(method, shape, "direction/mean")))
          << method << shape;
}

// 100 f / radius of curvature for a continuous force is the lower bound.
void expect_smooth_methods_change_as_the_surface_curves() {
  const double of_sphere = 100 * 0.5 * 0.01 / 20;
  for (const char* method : {"trilinear", "b-spline", "smooth-sphere"}) {
    EXPECT_GT(value(founding(method, "sphere-20mm", "choppiness/p99")), of_sphere);
    EXPECT_LT(value(founding(method, "sphere-20mm", "choppiness/max")), 3 * of_sphere);
  }
}

// The published sphere is smooth between half voxels; at half voxels its window moves by a plane of voxels.
void expect_gaussian_sphere_to_jump_at_half_voxels_alone() {
  for (const char* method : {"gaussian-sphere", "gaussian-sphere-sigma-2"}) {
    const double jumps = value(founding(method, "sphere-20mm", "choppiness-at-half-voxels/max"));
    EXPECT_GT(jumps, 5 * value(founding(method, "sphere-20mm", "choppiness-between/max")));
    EXPECT_EQ(jumps, value(founding(method, "sphere-20mm", "choppiness/max")));
  }
  // largest weight that enters or leaves: a plane of the window 2.5 voxels away, half of it full
  EXPECT_GT(value(founding("gaussian-sphere-sigma-2", "sphere-20mm", "choppiness-at-half-voxels/max")),
            value(founding("gaussian-sphere", "sphere-20mm", "choppiness-at-half-voxels/max")));
}

// a single test, because the figures take seconds
TEST(Accuracy, FiguresAreWithinLimitsAndMatchTheory) {
  expect_every_method_measured();
  expect_limits_met();
  expect_limits_as_requested();
  expect_exact_plane_turned_by_differences_alone();
  expect_exact_plane_errs_by_interpolation_alone();
  expect_exact_distances_of_a_plane_off_by_half_a_step();
  expect_exact_samples_better_than_voxelised();
  expect_more_bits_better();
  expect_spline_better_than_differences();
  expect_narrower_worse();
  expect_smooth_methods_change_as_the_surface_curves();
  expect_gaussian_sphere_to_jump_at_half_voxels_alone();
}

TEST(AccuracyLimit, IsFoundByMethodShapeAndSpacing) {
  EXPECT_EQ(accuracy_limit("trilinear/sphere-20mm/0.3x0.3x0.3/direction/mean"), 0.159);
  const auto narrow = accuracy_limit("b-spline/sphere-20mm/0.3x0.3x0.3/sigma-1.0/direction/mean");
  const auto wide = accuracy_limit("b-spline/sphere-20mm/0.3x0.3x0.3/direction/mean");
  ASSERT_TRUE(narrow && wide);
  EXPECT_GT(*narrow, *wide);
  for (const char* none :
       {"", "/", "b-spline", "b-spline/sphere-20mm", "b-spline/sphere-20mm/0.3x0.3x0.3",
        "b-spline/sphere-20mm/0.3x0.3x0.3/direction", "b-spline/sphere-20mm/0.3x0.3x0.3/direction/max",
        "b-spline/sphere-20mm/0.3x0.3x0.3/magnitude/mean", "b-spline/sphere-20mm/0.31x0.3x0.3/direction/mean",
        "b-spline/sphere-20mm/0.3x0.3x0.3/choppiness/max", "b-splin/sphere-20mm/0.3x0.3x0.3/direction/mean"})
    EXPECT_FALSE(accuracy_limit(none)) << none;
}

TEST(Accuracy, StopsWhenAsked) {
  std::atomic<bool> stop = false;
  const Progress progress([&](std::string_view, double) { stop = true; }, &stop);
  const auto interrupted = run_accuracy(progress);
  ASSERT_FALSE(interrupted.ok());
  EXPECT_EQ(interrupted.error().kind, ErrorKind::kInterrupted);

  auto cases = accuracy_cases(20);
  const auto measured =
      measure_on_grid(ShapeTruth(cases[0]), "sphere-20mm/3x3x3", Eigen::Vector3d(3, 3, 3), progress);
  ASSERT_FALSE(measured.ok());
  EXPECT_EQ(measured.error().kind, ErrorKind::kInterrupted);
}

}  // namespace
}  // namespace palpate
