#include <gtest/gtest.h>

#include <map>
#include <random>

#include "palpate/volume/label_map.h"
#include "palpate/volume/volume.h"
#include "volume/test_grids.h"

namespace palpate {
namespace {

// flood fill, voxel by voxel: slow and simple
std::map<LabelId, SegmentStatistics> flood_oracle(const Volume<LabelId>& labels) {
  const GridGeometry& g = labels.geometry();
  std::vector<bool> visited(g.voxel_count(), false);
  std::map<LabelId, SegmentStatistics> all;
  std::map<LabelId, Eigen::Vector3d> sums;
  for (int k = 0; k < g.dims[2]; ++k)
    for (int j = 0; j < g.dims[1]; ++j)
      for (int i = 0; i < g.dims[0]; ++i) {
        const LabelId value = labels.at(i, j, k);
        if (value == 0) continue;
        SegmentStatistics& s = all[value];
        const std::array<int, 3> at{i, j, k};
        for (std::size_t a = 0; a < 3; ++a) {
          s.box_min[a] = s.voxels == 0 ? at[a] : std::min(s.box_min[a], at[a]);
          s.box_max[a] = s.voxels == 0 ? at[a] : std::max(s.box_max[a], at[a]);
        }
        if (s.voxels == 0) sums[value].setZero();
        ++s.voxels;
        sums[value] += (g.X_PatientVoxel() * Point<Voxel>(i, j, k)).eigen();
        if (visited[g.offset(i, j, k)]) continue;

        std::size_t size = 0;
        std::vector<std::array<int, 3>> stack{at};
        visited[g.offset(i, j, k)] = true;
        while (!stack.empty()) {
          const auto [x, y, z] = stack.back();
          stack.pop_back();
          ++size;
          for (int dz = -1; dz <= 1; ++dz)
            for (int dy = -1; dy <= 1; ++dy)
              for (int dx = -1; dx <= 1; ++dx) {
                const std::array<int, 3> n{x + dx, y + dy, z + dz};
                if (std::abs(dx) + std::abs(dy) + std::abs(dz) != 1) continue;
                if (labels.at_or(n[0], n[1], n[2], 0) != value || visited[g.offset(n[0], n[1], n[2])])
                  continue;
                visited[g.offset(n[0], n[1], n[2])] = true;
                stack.push_back(n);
              }
        }
        ++s.components;
        s.largest_component_voxels = std::max(s.largest_component_voxels, size);
      }
  for (auto& [value, s] : all) s.centroid = Point<Patient>(sums[value] / static_cast<double>(s.voxels));
  return all;
}

LabelMap single(Volume<LabelId> layer, LabelId highest) {
  LabelMap labels;
  labels.layers.push_back(std::move(layer));
  for (LabelId v = 1; v <= highest; ++v) labels.segments.push_back({v, "", {}, 0, v});
  return labels;
}

void expect_oracle(const LabelMap& labels) {
  const auto oracle = flood_oracle(labels.layers[0]);
  const auto statistics = segment_statistics(labels);
  ASSERT_EQ(statistics.size(), oracle.size());
  for (const SegmentStatistics& s : statistics) {
    SCOPED_TRACE("label " + std::to_string(s.id));
    const SegmentStatistics& o = oracle.at(s.id);
    EXPECT_EQ(s.voxels, o.voxels);
    EXPECT_EQ(s.box_min, o.box_min);
    EXPECT_EQ(s.box_max, o.box_max);
    EXPECT_EQ(s.components, o.components);
    EXPECT_EQ(s.largest_component_voxels, o.largest_component_voxels);
    EXPECT_LT((s.centroid - o.centroid).norm(), 1e-9);
    const GridGeometry& g = labels.geometry();
    EXPECT_NEAR(
        s.volume_mm3,
        static_cast<double>(o.voxels) * std::abs((g.direction * g.spacing_mm.asDiagonal()).determinant()),
        1e-9 * s.volume_mm3);
  }
}

// from isolated voxels to a single component: components change most around a fill of 0.3 for six neighbours
TEST(SegmentStatistics, EqualsFloodFillOnRandomLabels) {
  const unsigned seed = 20240607;
  std::mt19937 random(seed);
  for (const GridGeometry& g : testing::awkward_grids({13, 11, 9})) {
    for (const double fill : {0.01, 0.1, 0.3, 0.5, 0.8, 1.0}) {
      SCOPED_TRACE("seed " + std::to_string(seed) + ", fill " + std::to_string(fill));
      Volume<LabelId> layer(g);
      for (LabelId& v : layer.voxels())
        if (std::uniform_real_distribution<>(0, 1)(random) < fill) v = static_cast<LabelId>(1 + random() % 3);
      expect_oracle(single(std::move(layer), 3));
    }
  }
}

// grids that are one voxel thick along at least one axis
TEST(SegmentStatistics, EqualsFloodFillOnThinGrids) {
  const unsigned seed = 5;
  std::mt19937 random(seed);
  for (const std::array<int, 3> dims : {std::array{1, 1, 1},
                                        {17, 1, 1},
                                        {1, 17, 1},
                                        {1, 1, 17},
                                        {9, 9, 1},
                                        {9, 1, 9},
                                        {1, 9, 9},
                                        {2, 2, 2}}) {
    GridGeometry g;
    g.dims = dims;
    Volume<LabelId> layer(g);
    for (LabelId& v : layer.voxels()) v = static_cast<LabelId>(random() % 3);
    expect_oracle(single(std::move(layer), 2));
  }
}

TEST(SegmentStatistics, JoinsAcrossFacesOnlyAndAcrossALateBridge) {
  GridGeometry g;
  g.dims = {5, 5, 3};
  Volume<LabelId> layer(g);
  layer.at(0, 0, 0) = layer.at(0, 0, 1) = 1;
  layer.at(1, 1, 1) = 1;  // shares an edge with the second
  layer.at(2, 2, 2) = 1;  // shares a corner with the third
  const auto statistics = segment_statistics(single(layer, 1));
  ASSERT_EQ(statistics.size(), 1u);
  EXPECT_EQ(statistics[0].components, 3);
  EXPECT_EQ(statistics[0].largest_component_voxels, 2u);

  // a U whose arms meet only in its last row
  Volume<LabelId> u(g);
  for (int j = 0; j < 5; ++j) u.at(0, j, 1) = u.at(4, j, 1) = 1;
  for (int i = 0; i < 5; ++i) u.at(i, 4, 1) = 1;
  EXPECT_EQ(segment_statistics(single(u, 1))[0].components, 1);
}

TEST(SegmentStatistics, CountsLayersSeparatelyAndSkipsEmptySegments) {
  GridGeometry g;
  g.dims = {4, 1, 1};
  LabelMap labels;
  labels.layers.assign(2, Volume<LabelId>(g));
  labels.layers[0].voxels() = {1, 1, 0, 0};
  labels.layers[1].voxels() = {0, 1, 0, 1};
  labels.segments = {{1, "a", {}, 0, 1}, {2, "b", {}, 1, 1}, {3, "nowhere", {}, 1, 3}};
  const auto statistics = segment_statistics(labels);
  ASSERT_EQ(statistics.size(), 2u);
  EXPECT_EQ(statistics[0].id, 1);
  EXPECT_EQ(statistics[0].components, 1);
  EXPECT_EQ(statistics[1].id, 2);
  EXPECT_EQ(statistics[1].components, 2);
  EXPECT_EQ(statistics[1].box_min, (std::array{1, 0, 0}));
  EXPECT_EQ(statistics[1].box_max, (std::array{3, 0, 0}));
}

}  // namespace
}  // namespace palpate
