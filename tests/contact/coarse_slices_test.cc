#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <numbers>
#include <random>
#include <utility>
#include <vector>

#include "base/test_files.h"
#include "base/test_seed.h"
#include "contact_body.h"

/// Tools of all radii on slices up to 5 mm thick slide evenly, and are free where no surface is in contact.
namespace palpate::coarse_slices {
namespace {

using namespace test;

constexpr double kInPlane_mm = 0.8, kDepth_mm = 1, kGuided_mm = 0.05;

GridGeometry grid_of(const Eigen::Vector3d& size_mm, const Eigen::Vector3d& spacing_mm) {
  GridGeometry grid;
  for (int a = 0; a < 3; ++a) grid.dims[a] = static_cast<int>(std::ceil(size_mm[a] / spacing_mm[a])) + 1;
  grid.spacing_mm = spacing_mm;
  return grid;
}

Body body_of(const GridGeometry& grid, double radius_mm,
             const std::function<bool(const Eigen::Vector3d&)>& is_inside) {
  LabelMap map;
  map.layers.emplace_back(grid);
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i)
        map.layers[0].at(i, j, k) = is_inside((X_PatientVoxel * Point<Voxel>(i, j, k)).eigen()) ? 1 : 0;
  map.segments = {{1, "bone", {}, 0, LabelId{1}}};
  Model model = model_of(map, [](const Segment&) { return 1.0; });
  model.tools[0].radius_mm = radius_mm;
  return one_body(model);
}

struct Slide {
  double ripple = 0;  ///< Ripple of the force: peak to peak over the mean
  double mean_N = 0;
  double behind_mm = 0;  ///< Maximum lateral distance of the proxy from the tip
};

// A tip that is led at an even depth along the steepest line of a plane.
Slide slide_on_a_plane(double slice_mm, double tilt_deg, double radius_mm, std::mt19937& random) {
  std::uniform_real_distribution<double> within(0, 1);
  const double tilt = tilt_deg * std::numbers::pi / 180, turn = 2 * std::numbers::pi * within(random);
  const Eigen::Vector3d level(std::cos(turn), std::sin(turn), 0);
  const Eigen::Vector3d up = std::sin(tilt) * level + std::cos(tilt) * Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d along = std::cos(tilt) * level - std::sin(tilt) * Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d spacing(kInPlane_mm, kInPlane_mm, slice_mm);
  const Eigen::Vector3d size(56, 56, 24 + 12 * slice_mm / 2.5 + 40 * std::tan(tilt));
  const Eigen::Vector3d centre =
      size / 2 + Eigen::Vector3d(within(random), within(random), within(random)).cwiseProduct(spacing);
  const Body body = body_of(grid_of(size, spacing), radius_mm,
                            [&](const Eigen::Vector3d& p) { return (p - centre).dot(up) < 0; });
  const ToolPart tool{{}, radius_mm};
  ProxyState state;
  std::vector<double> forces_N;
  Slide slide;
  const auto to = [&](const Eigen::Vector3d& tip) {
    return advance_proxy(body.surfaces, {&tool, 1}, Point<Patient>(tip), state);
  };
  constexpr double kHalf_mm = 12, kSettle_mm = 4;
  const Eigen::Vector3d begin = centre - (kHalf_mm + kSettle_mm) * along;
  for (double above_mm = radius_mm + 1; above_mm > radius_mm - kDepth_mm; above_mm -= kGuided_mm)
    to(begin + above_mm * up);
  for (double distance_mm = 0; distance_mm < 2 * kHalf_mm + kSettle_mm; distance_mm += kGuided_mm) {
    const Eigen::Vector3d tip = begin + (radius_mm - kDepth_mm) * up + distance_mm * along;
    const ProxyResult result = to(tip);
    if (distance_mm < kSettle_mm) continue;
    forces_N.push_back(result.force_N.norm());
    slide.behind_mm = std::max(slide.behind_mm, std::abs((state.position.eigen() - tip).dot(along)));
  }
  const auto [least, most] = std::minmax_element(forces_N.begin(), forces_N.end());
  for (const double force_N : forces_N) slide.mean_N += force_N / static_cast<double>(forces_N.size());
  slide.ripple = (*most - *least) / slide.mean_N;
  return slide;
}

TEST(CoarseSlices, ToolsOfAnyRadiusSlideEvenly) {
  const auto seed = test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  for (const double slice_mm : {2.5, 4.0, 5.0})
    for (const double tilt_deg : {5.0, 10.0, 20.0, 35.0})
      for (const double radius_mm : {0.0, 1.5, 3.0}) {
        const Slide slide = slide_on_a_plane(slice_mm, tilt_deg, radius_mm, random);
        std::printf(
            "slices %.1f mm, plane of %2.0f deg, tool %.1f mm: ripple %4.1f %%, mean %.3f N, behind %.2f "
            "mm\n",
            slice_mm, tilt_deg, radius_mm, 100 * slide.ripple, slide.mean_N, slide.behind_mm);
        SCOPED_TRACE(testing::Message() << slice_mm << " mm, " << tilt_deg << " deg, " << radius_mm << " mm");
        // terraces of 5 degrees are longer than what is smoothed over
        if (tilt_deg > 5) {
          EXPECT_LE(slide.ripple, slice_mm > 4 ? 0.2 : 0.15);
        }
        EXPECT_LE(slide.behind_mm, 1) << "stuck";
      }
}

// as wide as a finger: around a ball, where its force is known
TEST(WideTools, FingerIsConstrainedAndReleasedByABall) {
  for (const double slice_mm : {0.8, 1.5, 2.5})
    for (const double radius_mm : {4.0, 8.0, 12.0}) {
      SCOPED_TRACE(testing::Message() << slice_mm << " mm, " << radius_mm << " mm");
      constexpr double kBall_mm = 12;
      const Eigen::Vector3d centre(18, 18, 18);
      const Body body = body_of(grid_of({36, 36, 36}, {kInPlane_mm, kInPlane_mm, slice_mm}), radius_mm,
                                [&](const Eigen::Vector3d& p) { return (p - centre).norm() < kBall_mm; });
      const ToolPart tool{{}, radius_mm};
      ProxyState state;
      ProxyResult result;
      const auto to = [&](double height_mm, double angle) {
        const Eigen::Vector3d up(std::cos(angle), std::sin(angle), 0);
        result = advance_proxy(body.surfaces, {&tool, 1}, Point<Patient>(centre + height_mm * up), state);
      };
      const double touching_mm = kBall_mm + radius_mm;
      for (double height_mm = touching_mm + 2; height_mm > touching_mm + 0.5; height_mm -= kGuided_mm) {
        to(height_mm, 0);
        EXPECT_EQ(result.force_N, Vector<Patient>()) << "it is free";
      }
      for (double height_mm = touching_mm + 0.5; height_mm > touching_mm - kDepth_mm; height_mm -= kGuided_mm)
        to(height_mm, 0);
      // around it in the plane of a slice: beyond the last one the labels do not say where a ball ends
      for (double angle = 0; angle < 1.2; angle += kGuided_mm / touching_mm) {
        to(touching_mm - kDepth_mm, angle);
        EXPECT_NEAR(result.force_N.norm(), kDepth_mm, 0.25);
        const Eigen::Vector3d up(std::cos(angle), std::sin(angle), 0);
        EXPECT_GT(result.force_N.eigen().normalized().dot(up), std::cos(0.2));
      }
      for (double height_mm = touching_mm - kDepth_mm; height_mm < touching_mm + 2; height_mm += kGuided_mm)
        to(height_mm, 1.2);
      for (int n = 0; n < 100; ++n) to(touching_mm + 2, 1.2);
      EXPECT_EQ(result.force_N, Vector<Patient>());
    }
}

}  // namespace
}  // namespace palpate::coarse_slices
