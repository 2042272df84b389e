#include <gtest/gtest.h>

#include <random>

#include "palpate/volume/label_map.h"
#include "palpate/volume/resample.h"
#include "palpate/volume/volume.h"
#include "volume/test_grids.h"

namespace palpate {
namespace {

using testing::awkward_grids;

// linear in millimetres: reproduced exactly by trilinear interpolation
double linear_field(const Point<Patient>& p) {
  return 3.0 + 0.5 * p.x() - 0.25 * p.y() + 2.0 * p.z();
}

Volume<float> sampled(const GridGeometry& g) {
  Volume<float> volume(g);
  for (int k = 0; k < g.dims[2]; ++k)
    for (int j = 0; j < g.dims[1]; ++j)
      for (int i = 0; i < g.dims[0]; ++i)
        volume.at(i, j, k) = static_cast<float>(linear_field(g.X_PatientVoxel() * Point<Voxel>(i, j, k)));
  return volume;
}

// grid about the same centre with another spacing and other axes
GridGeometry concentric(const GridGeometry& g, const Eigen::Matrix3d& direction) {
  GridGeometry other = testing::grid({9, 15, 12}, {1.1, 0.6, 0.9}, direction, {});
  other.origin += g.centre() - other.centre();
  return other;
}

TEST(ResampleLinear, IsExactOnALinearFieldBetweenAnyTwoGrids) {
  constexpr float kOutside = -1e6f;
  int inside = 0, outside = 0;
  for (const GridGeometry& from : awkward_grids({12, 9, 7})) {
    const Volume<float> scan = sampled(from);
    for (const Eigen::Matrix3d& direction :
         {testing::oblique(), testing::permuted(), testing::left_handed()}) {
      const GridGeometry to = concentric(from, direction);
      const auto result = resample_linear(scan, to, kOutside);
      ASSERT_TRUE(result);
      for (int k = 0; k < to.dims[2]; ++k)
        for (int j = 0; j < to.dims[1]; ++j)
          for (int i = 0; i < to.dims[0]; ++i) {
            const Point<Patient> p = to.X_PatientVoxel() * Point<Voxel>(i, j, k);
            const Point<Voxel> v = from.X_PatientVoxel().inverse() * p;
            double beyond = 0;  // distance outside the voxel centres; voxels
            for (int a = 0; a < 3; ++a)
              beyond = std::max({beyond, -v[a], v[a] - (from.dims[static_cast<std::size_t>(a)] - 1)});
            if (beyond == 0) {
              ++inside;
              EXPECT_NEAR(result->at(i, j, k), linear_field(p), 1e-4);
            } else if (beyond > 0.51) {
              ++outside;
              EXPECT_EQ(result->at(i, j, k), kOutside);
            } else if (beyond < 0.49) {
              EXPECT_NE(result->at(i, j, k), kOutside)
                  << "the half voxel around a centre belongs to the grid";
            }
          }
    }
  }
  EXPECT_GT(inside, 1000);
  EXPECT_GT(outside, 1000);
}

TEST(ResampleLinear, OntoItsOwnGridChangesNothing) {
  for (const GridGeometry& g : awkward_grids({6, 5, 4})) {
    const Volume<float> scan = sampled(g);
    const auto result = resample_linear(scan, g, -1e6f);
    ASSERT_TRUE(result);
    for (std::size_t n = 0; n < scan.voxels().size(); ++n)
      EXPECT_NEAR(result->voxels()[n], scan.voxels()[n], 1e-4);
  }
}

TEST(ResampleNearest, EqualsTheNearestCentreFoundBySearch) {
  const unsigned seed = 77;
  std::mt19937 random(seed);
  for (const GridGeometry& from : awkward_grids({7, 6, 5})) {
    LabelMap labels;
    labels.layers.assign(2, Volume<LabelId>(from));
    for (auto& layer : labels.layers)
      for (LabelId& v : layer.voxels()) v = static_cast<LabelId>(1 + random() % 200);
    const GridGeometry to = concentric(from, testing::oblique());
    const auto result = resample_nearest(labels, to);
    ASSERT_TRUE(result);
    ASSERT_EQ(result->layers.size(), 2u);
    EXPECT_TRUE(result->geometry().same_grid(to));
    int compared = 0;
    for (int k = 0; k < to.dims[2]; ++k)
      for (int j = 0; j < to.dims[1]; ++j)
        for (int i = 0; i < to.dims[0]; ++i) {
          const Point<Voxel> p =
              from.X_PatientVoxel().inverse() * (to.X_PatientVoxel() * Point<Voxel>(i, j, k));
          // voxel whose cell contains the point, found by exhaustive search
          std::array<int, 3> best{-1, -1, -1};
          bool at_a_face = false;
          for (int z = 0; z < from.dims[2]; ++z)
            for (int y = 0; y < from.dims[1]; ++y)
              for (int x = 0; x < from.dims[0]; ++x) {
                const double d = (p - Point<Voxel>(x, y, z)).eigen().lpNorm<Eigen::Infinity>();
                at_a_face |= std::abs(d - 0.5) < 1e-5;
                if (d < 0.5) best = {x, y, z};
              }
          if (at_a_face) continue;
          ++compared;
          for (std::size_t layer = 0; layer < 2; ++layer)
            EXPECT_EQ(result->layers[layer].at(i, j, k),
                      labels.layers[layer].at_or(best[0], best[1], best[2], 0));
        }
    EXPECT_GT(compared, 1000) << "seed " << seed;
  }
}

TEST(Resample, WithoutOverlapIsAnError) {
  for (const GridGeometry& g : awkward_grids({6, 5, 4})) {
    GridGeometry far = g;
    far.origin += Vector<Patient>(500, 0, 0);
    const auto scan = resample_linear(sampled(g), far, 0);
    ASSERT_FALSE(scan);
    EXPECT_EQ(scan.error().kind, ErrorKind::kBadInput);
    EXPECT_FALSE(scan.error().remedy.empty());
    LabelMap labels;
    labels.layers.emplace_back(g, LabelId{1});
    EXPECT_FALSE(resample_nearest(labels, far));

    // touching by the last slice counts as overlap
    GridGeometry beside = g;
    beside.origin += g.X_PatientVoxel() * Vector<Voxel>(g.dims[0] - 1, 0, 0);
    EXPECT_TRUE(resample_nearest(labels, beside));
  }
}

}  // namespace
}  // namespace palpate
