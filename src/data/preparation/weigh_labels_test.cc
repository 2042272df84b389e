#include <gtest/gtest.h>

#include <random>

#include "palpate/preparation/preparation.h"

namespace palpate {
namespace {

GridGeometry grid_of(std::array<int, 3> dims) {
  GridGeometry grid;
  grid.dims = dims;
  return grid;
}

TEST(WeighLabels, LooksEveryVoxelUpInTheTable) {
  std::mt19937 random(1);
  Volume<LabelId> labels(grid_of({11, 7, 5}));
  for (auto& voxel : labels.voxels()) voxel = static_cast<LabelId>(random() % 6);
  const std::vector<std::uint8_t> weights{0, 255, 40, 7};

  const auto weighed = weigh_labels(labels, weights);
  for (std::size_t n = 0; n < weighed.voxels().size(); ++n) {
    const LabelId id = labels.voxels()[n];
    // ids beyond the table have weight 0
    EXPECT_EQ(weighed.voxels()[n], id < weights.size() ? weights[id] : 0);
  }
}

TEST(WeighLabels, ReachesTheLastLabelThereCanBe) {
  Volume<LabelId> labels(grid_of({2, 1, 1}));
  labels.voxels() = {65535, 0};
  std::vector<std::uint8_t> weights(65536);
  weights[65535] = 9;
  EXPECT_EQ(weigh_labels(labels, weights).voxels(), (std::vector<std::uint8_t>{9, 0}));
}

}  // namespace
}  // namespace palpate
