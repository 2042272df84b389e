#include "surfaces/touching.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <random>
#include <string>

#include "base/test_seed.h"
#include "palpate/surfaces/surfaces.h"

namespace palpate {
namespace {

using internal::Adjacency;
using internal::Touching;

Volume<LabelId> random_labels(std::mt19937& random, int max_dim) {
  GridGeometry grid;
  std::uniform_int_distribution<int> size(1, max_dim), label(0, 30);
  for (int& dim : grid.dims) dim = size(random);
  Volume<LabelId> labels(grid);
  for (LabelId& voxel : labels.voxels()) voxel = static_cast<LabelId>(std::max(0, label(random) - 24));
  return labels;
}

// oracle: examines every voxel's neighbours
bool touch(const Volume<LabelId>& labels, LabelId a, LabelId b, Adjacency adjacency) {
  const auto& dims = labels.geometry().dims;
  for (int k = 0; k < dims[2]; ++k)
    for (int j = 0; j < dims[1]; ++j)
      for (int i = 0; i < dims[0]; ++i)
        for (int dk = -1; dk <= 1; ++dk)
          for (int dj = -1; dj <= 1; ++dj)
            for (int di = -1; di <= 1; ++di) {
              if (adjacency == Adjacency::kFace && std::abs(di) + std::abs(dj) + std::abs(dk) != 1) continue;
              if (labels.at(i, j, k) == a && labels.at_or(i + di, j + dj, k + dk, 0) == b) return true;
            }
  return false;
}

TEST(Touching, EqualsASearchOverVoxelNeighbours) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("PALPATE_TEST_SEED=" + std::to_string(seed));
  std::mt19937 random(seed);
  const std::vector<int> index{-1, 0, 1, 2, 3, 4, -1};
  for (int round = 0; round < 60; ++round) {
    const Volume<LabelId> labels = random_labels(random, 6);
    for (const Adjacency adjacency : {Adjacency::kFace, Adjacency::kFaceEdgeOrCorner})
      for (const int threads : {1, 3}) {
        const auto found =
            internal::find_touching(*label_bricks(labels), index, 5, adjacency, threads, {}, {"test"});
        ASSERT_TRUE(found.ok());
        for (std::size_t a = 0; a < 5; ++a)
          for (std::size_t b = 0; b < a; ++b)
            EXPECT_EQ((*found)(a, b),
                      touch(labels, static_cast<LabelId>(a + 1), static_cast<LabelId>(b + 1), adjacency))
                << "round " << round;
      }
  }
}

TEST(TouchingGroups, AreConnectedComponents) {
  GridGeometry grid;
  grid.dims = {12, 3, 3};
  Volume<LabelId> labels(grid);
  // 5 and 2 touch by a face, 2 and 9 by a corner; 4 is isolated, 7 is one voxel away from 4; 1 touches 4 and
  // is not requested
  labels.at(0, 0, 0) = 5;
  labels.at(1, 0, 0) = 2;
  labels.at(2, 1, 1) = 9;
  labels.at(6, 0, 0) = 4;
  labels.at(8, 0, 0) = 7;
  labels.at(7, 0, 0) = 1;
  const auto touching = touching_pairs(*label_bricks(labels), {2, 4, 5, 7, 9});
  ASSERT_TRUE(touching.ok());
  EXPECT_EQ(touching->size(), 2u);
  using Groups = std::vector<std::vector<LabelId>>;
  EXPECT_EQ(touching_groups({2, 4, 5, 7, 9}, *touching), (Groups{{2, 5, 9}, {4}, {7}}));
  EXPECT_EQ(touching_groups({9, 7, 5}, *touching), (Groups{{9}, {7}, {5}})) << "without the one between";
}

TEST(OuterSurfaces, HaveNoCrackWhereStructuresMeet) {
  // flat top of a block whose labels change along a plane
  GridGeometry grid;
  grid.dims = {80, 80, 24};
  grid.spacing_mm = {0.36, 0.36, 0.7};
  Volume<LabelId> labels(grid);
  for (int k = 0; k < 12; ++k)
    for (int j = 4; j < 76; ++j)
      for (int i = 4; i < 76; ++i) labels.at(i, j, k) = 2 * i + j < 120 ? 3 : 8;
  const auto outer = prepare_outer_surfaces(*label_bricks(labels), {{3, 8}}, {});
  const auto own = prepare_surfaces(*label_bricks(labels), {3, 8}, {});
  ASSERT_TRUE(outer.ok() && own.ok());
  ASSERT_EQ(outer->size(), 1u);
  double own_dip_mm = 0, outer_dip_mm = 0;
  const double top_mm = 11.5 * 0.7;
  for (double x = 12; x < 17; x += 0.05) {
    const Point<Patient> at(x, 14.4, top_mm);
    own_dip_mm =
        std::max(own_dip_mm, std::min((*own)[0].surface.distance_mm(at), (*own)[1].surface.distance_mm(at)));
    outer_dip_mm = std::max(outer_dip_mm, std::abs(outer->front()->distance_mm(at)));
    EXPECT_GT(outer->front()->outward(at).z(), 0.999) << x;
  }
  EXPECT_GT(own_dip_mm, 0.3);
  EXPECT_LT(outer_dip_mm, 0.1);
  // the same as for a single label
  Volume<LabelId> one = labels;
  for (LabelId& label : one.voxels()) label = label == 0 ? LabelId{0} : LabelId{3};
  const auto whole = prepare_surfaces(*label_bricks(one), {3}, {});
  ASSERT_TRUE(whole.ok());
  EXPECT_EQ(outer->front()->content_hash(), whole->front().surface.content_hash());
  // a group of one structure that touches none is unchanged
  const auto alone = prepare_outer_surfaces(*label_bricks(labels), {{8}}, {});
  ASSERT_TRUE(alone.ok());
  EXPECT_EQ(alone->front()->content_hash(), (*own)[1].surface.content_hash());
}

}  // namespace
}  // namespace palpate
