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

Segment segment(LabelId id, int layer, LabelId value) {
  Segment segment;
  segment.id = id;
  segment.layer = layer;
  segment.value = value;
  return segment;
}

TEST(WeighLabels, LooksEveryVoxelUpInTheTable) {
  std::mt19937 random(1);
  LabelMap labels;
  labels.layers.emplace_back(grid_of({11, 7, 5}));
  for (auto& voxel : labels.layers[0].voxels()) voxel = static_cast<LabelId>(random() % 6);
  labels.segments = {segment(1, 0, 1), segment(2, 0, 2), segment(5, 0, 5)};
  const std::vector<std::uint8_t> weights{0, 255, 40, 7};

  const auto weighed = weigh_labels(labels, weights);
  for (std::size_t n = 0; n < weighed.voxels().size(); ++n) {
    const LabelId id = labels.layers[0].voxels()[n];
    // ids beyond the table weigh nothing
    EXPECT_EQ(weighed.voxels()[n], id < weights.size() ? weights[id] : 0);
  }
}

TEST(WeighLabels, ReachesTheLastLabelThereCanBe) {
  LabelMap labels;
  labels.layers.emplace_back(grid_of({2, 1, 1}));
  labels.layers[0].voxels() = {65535, 0};
  labels.segments = {segment(65535, 0, 65535)};
  std::vector<std::uint8_t> weights(65536);
  weights[65535] = 9;
  EXPECT_EQ(weigh_labels(labels, weights).voxels(), (std::vector<std::uint8_t>{9, 0}));
}

TEST(WeighLabels, TakesTheLargestWeightWhereLayersOverlap) {
  // both layers use the value 1, for different segments
  LabelMap labels;
  labels.layers.assign(2, Volume<LabelId>(grid_of({4, 1, 1})));
  labels.layers[0].voxels() = {1, 1, 0, 0};
  labels.layers[1].voxels() = {1, 0, 1, 0};
  labels.segments = {segment(1, 0, 1), segment(2, 1, 1)};
  EXPECT_EQ(weigh_labels(labels, {0, 100, 30}).voxels(), (std::vector<std::uint8_t>{100, 100, 30, 0}));
  EXPECT_EQ(weigh_labels(labels, {0, 30, 100}).voxels(), (std::vector<std::uint8_t>{100, 30, 100, 0}));
}

}  // namespace
}  // namespace palpate
