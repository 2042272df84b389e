#include "verification/tissue_cases.h"

#include <gtest/gtest.h>

#include <cmath>

#include "verification/tissue_frame.h"

// The cases of `verify tissue`, smaller.

namespace palpate {
namespace {

TEST(TissueCases, AnEvenStrainIsExact) {
  for (const double nu : {0.0, 0.3, 0.49}) EXPECT_LE(patch_case(6, nu).error_percent, 1e-3) << nu;
}

TEST(TissueCases, TurningMakesNoForce) {
  EXPECT_LE(turned_case(5).error_percent, 1e-3);
}

TEST(TissueCases, ABeamBends) {
  EXPECT_LE(std::abs(cantilever_case(6).error_percent), 3);
}

TEST(TissueCases, CooksMembraneRises) {
  EXPECT_LE(std::abs(cook_case(24).error_percent), 3);
}

TEST(TissueCases, LayersAreInSeriesWhereverTheirSeamIs) {
  for (const double seam : {0.0, 0.3, 0.5, 0.95})
    EXPECT_LE(std::abs(series_case(seam).error_percent), 2) << seam;
}

TEST(TissueCases, ALoadSinksIn) {
  EXPECT_LE(std::abs(boussinesq_case(40, 0.45).error_percent), 5);
}

TEST(TissueCases, ASphereOnAHalfSpaceIsHertzs) {
  HalfSpacePress press;
  press.cells = 24;
  press.offset_cells = Vector<Patient>(0.2, 0.1, 0.3);
  for (const auto& outward : {Vector<Patient>(0, 0, 1), Vector<Patient>(1, 0.1, 0.9)}) {
    press.outward = outward;
    for (const double radius : {1.0, 3.0}) {
      press.radius_cells = radius;
      EXPECT_LE(std::abs(hertz_case(press).error_percent), 7);
    }
    press.radius_cells = 1;
    EXPECT_LE(ripple_case(press, 3).error_percent, 1.5);
  }
}

TEST(TissueCases, AFlatPunchAndALayer) {
  EXPECT_LE(std::abs(punch_case(32, 5).error_percent), 12);
  EXPECT_LE(std::abs(layer_case(8, 0.45, 0.4).error_percent), 5);
}

TEST(TissueCases, ErrorsFallWithTheSquareOfTheCells) {
  EXPECT_GE(convergence_order(8), 1.7);
}

TEST(TissueCases, WorkOverANoduleIsGivenBack) {
  const NoduleLoop loop = nodule_loop(32, 20);
  EXPECT_LE(std::abs(loop.error_percent), 2);
  // shows the effect of the tangential force
  EXPECT_GE(std::abs(loop.error_without_tangential_percent), 5);
  EXPECT_GE(loop.stiffer_percent, 10);
}

TEST(TissueCases, ANeoHookeanBlockIsStretched) {
  for (const double height_ratio : {0.6, 1.4})
    EXPECT_LE(std::abs(stretched_case(height_ratio).error_percent), 0.1) << height_ratio;
}

TEST(TissueCases, LinearIsNeoHookeanToAFifthOfTheThickness) {
  const FiniteLayer layer = finite_layer({47, 32, 8}, 0.2);
  EXPECT_TRUE(layer.converged);
  EXPECT_GT(layer.min_volume, 0);
  EXPECT_LE(std::abs(layer.linear_error_percent), 5);
}

TEST(TissueCases, AFrameFollowsTheTool) {
  const TissueFrame frame = measure_tissue_frame(4);
  EXPECT_GE(frame.cells, 38'000u);
  EXPECT_LE(frame.error_percent, 2);
  EXPECT_GT(frame.frame_ms, 0);
}

}  // namespace
}  // namespace palpate
