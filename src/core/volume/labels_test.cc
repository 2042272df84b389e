#include <gtest/gtest.h>

#include "palpate/volume/label_map.h"
#include "palpate/volume/volume.h"
#include "volume/test_grids.h"

namespace palpate {
namespace {

using testing::awkward_grids;

TEST(GridGeometry, SameGridIsComparedAtTheFarCorner) {
  for (const GridGeometry& g : awkward_grids({40, 30, 20})) {
    EXPECT_TRUE(g.same_grid(g));

    GridGeometry shifted = g;
    shifted.origin += g.X_PatientVoxel() * Vector<Voxel>(0, 0, 0.9e-3);
    EXPECT_TRUE(g.same_grid(shifted));
    shifted.origin += g.X_PatientVoxel() * Vector<Voxel>(0, 0, 0.2e-3);
    EXPECT_FALSE(g.same_grid(shifted));

    // a spacing error grows towards the far corner
    GridGeometry stretched = g;
    stretched.spacing_mm[0] *= 1 + 0.9e-3 / 39;
    EXPECT_TRUE(g.same_grid(stretched));
    stretched.spacing_mm[0] = g.spacing_mm[0] * (1 + 1.1e-3 / 39);
    EXPECT_FALSE(g.same_grid(stretched));
    EXPECT_TRUE(g.same_grid(stretched, 2e-3));

    GridGeometry smaller = g;
    smaller.dims[1] -= 1;
    EXPECT_FALSE(g.same_grid(smaller));
    GridGeometry mirrored = g;
    mirrored.direction.col(0) *= -1;
    EXPECT_FALSE(g.same_grid(mirrored));
    GridGeometry broken = g;
    broken.origin[1] = std::nan("");
    EXPECT_FALSE(g.same_grid(broken));
  }
}

LabelMap two_layers() {
  GridGeometry g;
  g.dims = {3, 1, 4};
  LabelMap labels;
  labels.layers.assign(2, Volume<LabelId>(g));
  labels.layers[0].at(0, 0, 1) = 1;
  labels.layers[0].at(1, 0, 1) = 1;
  labels.layers[1].at(1, 0, 1) = 1;
  labels.layers[1].at(2, 0, 3) = 7;
  labels.segments = {{1, "femur", {}, 0, 1}, {7, "tibia", {}, 1, 7}, {8, "cartilage", {}, 1, 1}};
  return labels;
}

TEST(LabelMap, FindsSegmentsByIdAndByExactName) {
  const LabelMap labels = two_layers();
  ASSERT_NE(labels.find(LabelId{8}), nullptr);
  EXPECT_EQ(labels.find(LabelId{8})->name, "cartilage");
  EXPECT_EQ(labels.find(LabelId{2}), nullptr);
  EXPECT_EQ(labels.find(LabelId{9}), nullptr);
  ASSERT_NE(labels.find("tibia"), nullptr);
  EXPECT_EQ(labels.find("tibia")->id, 7);
  EXPECT_EQ(labels.find("Tibia"), nullptr);
  EXPECT_EQ(labels.find("tib"), nullptr);
}

TEST(LabelMap, FlattensToIdsWithTheHighestLayerOnTop) {
  const Volume<LabelId> flat = two_layers().flattened();
  EXPECT_EQ(flat.at(0, 0, 1), 1);
  EXPECT_EQ(flat.at(1, 0, 1), 8) << "value 1 of layer 1 is segment 8 and lies over segment 1";
  EXPECT_EQ(flat.at(2, 0, 3), 7);
  EXPECT_EQ(flat.at(0, 0, 0), 0);
}

TEST(LabelMap, SliceIsEmptyOnlyIfEveryLayerIs) {
  EXPECT_EQ(empty_slices(two_layers()), (std::vector<int>{0, 2}));
}

}  // namespace
}  // namespace palpate
