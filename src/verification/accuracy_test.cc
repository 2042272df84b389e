#include "verification/accuracy.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <atomic>
#include <cmath>
#include <set>

namespace palpate {
namespace {

// the suite takes seconds: once for all checks
const std::vector<Figure>& figures() {
  static const std::vector<Figure> all = run_accuracy({}).value();
  return all;
}

double value(const std::string& name) {
  for (const Figure& figure : figures()) {
    if (figure.name == name) return figure.value;
  }
  ADD_FAILURE() << "no figure " << name;
  return std::nan("");
}

void expect_every_figure_once() {
  std::set<std::string> names;
  for (const Figure& figure : figures()) {
    EXPECT_TRUE(names.insert(figure.name).second) << figure.name;
    EXPECT_TRUE(std::isfinite(figure.value) && figure.value >= 0) << figure.name;
    EXPECT_EQ(figure.unit, figure.name.find("/direction/") != std::string::npos ? "deg" : "percent");
    EXPECT_GE(figure.n, 1000u);
  }
  EXPECT_EQ(names.size(), 4u * 3 * 4 * 6);  // shapes, spacings, methods, figures
  EXPECT_TRUE(names.contains("trilinear/sphere-20mm/0.625x0.625x0.9/direction/mean"));
  EXPECT_TRUE(names.contains("trilinear/torus-20-8mm/0.28x0.28x1.0/sigma-1.0/magnitude/p99"));
  EXPECT_TRUE(names.contains("trilinear-u8/cylinder-10mm/0.3x0.3x0.3/direction/max"));
  EXPECT_TRUE(names.contains("trilinear-exact/tilted-plane/0.3x0.3x0.3/direction/mean"));
}

void expect_mean_p99_max_in_order() {
  for (const Figure& figure : figures()) {
    if (!figure.name.ends_with("/mean")) continue;
    const std::string path = figure.name.substr(0, figure.name.size() - 4);
    EXPECT_LE(figure.value, value(path + "p99")) << path;
    EXPECT_LE(value(path + "p99"), value(path + "max")) << path;
  }
}

void expect_limits_kept() {
  for (const Figure& figure : figures()) {
    EXPECT_EQ(figure.limit.has_value(), !figure.name.ends_with("/max")) << figure.name;
    EXPECT_TRUE(figure.ok()) << figure.name << " " << figure.value << " > " << figure.limit.value_or(0);
    // a limit so wide that nothing breaks it would be none
    if (figure.limit) {
      EXPECT_LE(*figure.limit, 1.3 * figure.value + 0.02) << figure.name;
    }
  }
}

// A difference over +-h shortens the gradient along axis i by the profile's mean slope over h n_i: unequal
// spacings turn it. On exact samples of a plane that is all that is wrong, most at the surface.
double turned_by_differences_deg(const Eigen::Vector3d& spacing, double sigma) {
  const Eigen::Vector3d n(0.36, 0.48, 0.8);
  Eigen::Vector3d gradient;
  for (int a = 0; a < 3; ++a) {
    gradient[a] = std::erf(spacing[a] * n[a] / (sigma * std::sqrt(2.0))) / (2 * spacing[a]);
  }
  return std::acos(gradient.normalized().dot(n)) * 180 / std::acos(-1.0);
}

void expect_exact_plane_turned_by_differences_alone() {
  const std::string plane = "trilinear-exact/tilted-plane/";
  const auto ratio = [&](const char* spacing, const Eigen::Vector3d& mm) {
    return value(plane + spacing + "/direction/max") / turned_by_differences_deg(mm, 1.5);
  };
  EXPECT_NEAR(ratio("0.28x0.28x1.0", {0.28, 0.28, 1.0}), 1, 0.12);
  EXPECT_NEAR(ratio("0.625x0.625x0.9", {0.625, 0.625, 0.9}), 1, 0.12);
  EXPECT_NEAR(ratio("0.3x0.3x0.3", {0.3, 0.3, 0.3}), 1, 0.12);
}

void expect_exact_plane_errs_by_interpolation_alone() {
  // at most h^2 / 8 of the profile's second derivative, which is at most 0.242 / sigma^2, and half a stored
  // step
  const double most = 100 * (0.242 / (1.5 * 1.5) * 0.3 * 0.3 / 8 + 0.5 / 65535);
  EXPECT_LT(value("trilinear-exact/tilted-plane/0.3x0.3x0.3/magnitude/max"), most);
  EXPECT_GT(value("trilinear-exact/tilted-plane/0.3x0.3x0.3/magnitude/max"), 0.5 * most);
}

void expect_exact_samples_better_than_voxelised() {
  for (const char* shape : {"sphere-20mm", "cylinder-10mm", "torus-20-8mm"}) {
    for (const char* spacing : {"0.28x0.28x1.0", "0.625x0.625x0.9", "0.3x0.3x0.3"}) {
      for (const char* leaf : {"/direction/mean", "/direction/p99", "/magnitude/mean"}) {
        const std::string on = std::string("/") + shape + "/" + spacing + leaf;
        EXPECT_LT(value("trilinear-exact" + on), value("trilinear" + on)) << on;
      }
    }
  }
}

void expect_finer_better_and_narrower_worse() {
  for (const char* shape : {"sphere-20mm", "cylinder-10mm", "tilted-plane", "torus-20-8mm"}) {
    const std::string start = std::string("trilinear/") + shape + "/";
    EXPECT_LT(value(start + "0.3x0.3x0.3/direction/mean"), value(start + "0.28x0.28x1.0/direction/mean"))
        << shape;
    EXPECT_GT(value(start + "0.28x0.28x1.0/sigma-1.0/direction/mean"),
              value(start + "0.28x0.28x1.0/direction/mean"))
        << shape;
  }
}

void expect_eight_bits_no_better_than_sixteen() {
  for (const Figure& figure : figures()) {
    if (!figure.name.starts_with("trilinear-u8/") || !figure.name.ends_with("direction/mean")) continue;
    std::string sixteen = figure.name;
    sixteen.erase(9, 3);
    EXPECT_GE(figure.value, value(sixteen)) << sixteen;
  }
}

// one test, because the suite is run once for each
TEST(Accuracy, FiguresAreCompleteWithinLimitsAndAsPhysicsSays) {
  expect_every_figure_once();
  expect_mean_p99_max_in_order();
  expect_limits_kept();
  expect_exact_plane_turned_by_differences_alone();
  expect_exact_plane_errs_by_interpolation_alone();
  expect_exact_samples_better_than_voxelised();
  expect_finer_better_and_narrower_worse();
  expect_eight_bits_no_better_than_sixteen();
}

TEST(Accuracy, StopsWhenAsked) {
  std::atomic<bool> stop = false;
  const Progress progress([&](std::string_view, double fraction) { stop = stop || fraction > 0; }, &stop);
  const auto interrupted = run_accuracy(progress);
  ASSERT_FALSE(interrupted.ok());
  EXPECT_EQ(interrupted.error().kind, ErrorKind::kInterrupted);
}

}  // namespace
}  // namespace palpate
