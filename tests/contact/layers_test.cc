#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "contact_body.h"
#include "palpate/model/stiffness_layers.h"

/// Structures of many stiffnesses on top of each other, from labels.
namespace palpate::many_layers {
namespace {

using namespace test;

constexpr double kVoxel_mm = 0.5, kSlab_mm = 2, kWide_mm = 16;

// slabs of tissue in a block whose top is at z = 0, the first outermost
LabelMap slabs(int count) {
  GridGeometry grid;
  const int wide = static_cast<int>(kWide_mm / kVoxel_mm), slab = static_cast<int>(kSlab_mm / kVoxel_mm);
  grid.dims = {wide, wide, slab * count + wide};
  grid.spacing_mm = Eigen::Vector3d::Constant(kVoxel_mm);
  // between its centres the top lies half a voxel above the last of them
  grid.origin =
      Point<Patient>(Eigen::Vector3d(-0.5 * kWide_mm, -0.5 * kWide_mm, -count * kSlab_mm + 0.5 * kVoxel_mm));
  LabelMap map;
  map.layers.emplace_back(grid);
  for (int k = 0; k < slab * count; ++k)
    for (int j = 0; j < wide; ++j)
      for (int i = 0; i < wide; ++i) map.layers[0].at(i, j, k) = static_cast<LabelId>(count - k / slab);
  for (int n = 1; n <= count; ++n)
    map.segments.push_back(
        {static_cast<LabelId>(n), "slab " + std::to_string(n), {}, 0, static_cast<LabelId>(n)});
  return map;
}

// pressed straight in at the middle, by a point: the largest error of the force where it is above 0.05 N
double error_of_the_sum(const std::vector<double>& stiffnesses) {
  const auto count = static_cast<int>(stiffnesses.size());
  const Body body = one_body(model_of(slabs(count), [&](const Segment& segment) {
    return stiffnesses[static_cast<std::size_t>(segment.id) - 1];
  }));
  const ToolPart point{{}, 0};
  ProxyState state;
  double worst = 0, sum_N = 0;
  constexpr double kStep_mm = 0.02;
  for (double depth_mm = -3; depth_mm < (count - 1) * kSlab_mm; depth_mm += kStep_mm) {
    const double force_N =
        advance_proxy(body.surfaces, {&point, 1}, Point<Patient>(0.1, 0.1, -depth_mm), state).force_N.z();
    if (depth_mm <= 0) continue;
    sum_N += kStep_mm * stiffnesses[static_cast<std::size_t>(depth_mm / kSlab_mm)];
    if (sum_N > 0.05) worst = std::max(worst, std::abs(force_N - sum_N) / sum_N);
  }
  return worst;
}

std::vector<double> graded(int count, double softest, double factor) {
  std::vector<double> all;
  for (int n = 0; n < count; ++n) all.push_back(softest * std::pow(factor, n));
  return all;
}

// 5 % of the sum, and of the voxels what a slab of 2 mm shows of a place that is off by some hundredths
constexpr double kMaxError = 0.05;

TEST(ManyLayers, TwelveTissuesIntegrateStiffnessAlongTheEntryPath) {
  EXPECT_LT(error_of_the_sum(graded(12, 0.03, 1.42)), kMaxError);
}

TEST(ManyLayers, EightGradedTissuesIntegrateStiffnessAlongTheEntryPath) {
  EXPECT_LT(error_of_the_sum(graded(8, 0.1, 1.2)), kMaxError);
}

TEST(ManyLayers, MergedTissuesHaveTheReportedError) {
  const std::vector<double> twenty = graded(20, 0.03, 1.15);
  double declared = 0;
  for (const StiffnessRange& layer : stiffness_layers(twenty)) declared = std::max(declared, layer.error());
  EXPECT_GT(declared, 0.05);
  EXPECT_LT(error_of_the_sum(twenty), declared + kMaxError);
}

// as an atlas has them: what is felt alike needs one surface
TEST(ManyLayers, AcceptsThreeHundredLabelsOfFourTissues) {
  constexpr int kLabels = 312;
  GridGeometry grid;
  grid.dims = {40, 40, 40};
  grid.spacing_mm = Eigen::Vector3d::Ones();
  LabelMap map;
  map.layers.emplace_back(grid);
  for (int k = 2; k < 38; ++k)
    for (int j = 2; j < 38; ++j)
      for (int i = 2; i < 38; ++i)
        map.layers[0].at(i, j, k) = static_cast<LabelId>(1 + (i / 5 + 8 * (j / 5) + 64 * (k / 5)) % kLabels);
  for (int n = 1; n <= kLabels; ++n)
    map.segments.push_back(
        {static_cast<LabelId>(n), "region " + std::to_string(n), {}, 0, static_cast<LabelId>(n)});
  const Body body =
      one_body(model_of(map, [](const Segment& segment) { return 0.2 + 0.3 * (segment.id % 4); }));
  const auto shapes = std::count_if(body.surfaces.begin(), body.surfaces.end(),
                                    [](const ContactSurface& surface) { return surface.surface != nullptr; });
  EXPECT_LT(shapes, kLabels);
  const ToolPart ball{{}, 1.5};
  ProxyState state;
  Vector<Patient> force_N;
  for (double z = 44; z > 34; z -= 0.05)
    force_N = advance_proxy(body.surfaces, {&ball, 1}, Point<Patient>(20, 20, z), state).force_N;
  EXPECT_GT(force_N.z(), 0.5);
}

}  // namespace
}  // namespace palpate::many_layers
