#include "lint/voxel_runs.h"

#include <gtest/gtest.h>

#include <iostream>
#include <random>

#include "base/test_seed.h"
#include "lint/voxel_bits.h"

namespace palpate {
namespace {

using internal::Component;
using internal::RunVolume;
using internal::VoxelBits;

Volume<LabelId> random_blobs(std::mt19937& random, const std::array<int, 3>& dims) {
  GridGeometry grid;
  grid.dims = dims;
  Volume<LabelId> labels(grid);
  std::uniform_int_distribution<int> chance(0, 5);
  for (LabelId& value : labels.voxels()) value = static_cast<LabelId>(std::max(0, chance(random) - 3));
  return labels;
}

TEST(VoxelRuns, ComponentsEqualFloodFill) {
  const unsigned seed = test::test_seed();
  std::cout << "seed " << seed << '\n';
  std::mt19937 random(seed);
  for (int round = 0; round < 10; ++round) {
    const Volume<LabelId> labels = random_blobs(random, {7, 6, 5});
    RunVolume runs = *internal::runs_of(labels, 1, {}, {"runs"});
    const std::vector<Component> components = connect(runs);
    // flood fill from every voxel: 6-connected for background, 26-connected for labels
    std::vector<int> flooded(labels.voxels().size(), -1);
    const auto& grid = labels.geometry();
    int count = 0;
    for (int k = 0; k < 5; ++k)
      for (int j = 0; j < 6; ++j)
        for (int i = 0; i < 7; ++i) {
          if (flooded[grid.offset(i, j, k)] >= 0) continue;
          const LabelId value = labels.at(i, j, k);
          std::size_t voxels = 0;
          std::vector<std::array<int, 3>> todo{{i, j, k}};
          flooded[grid.offset(i, j, k)] = count;
          while (!todo.empty()) {
            const auto at = todo.back();
            todo.pop_back();
            ++voxels;
            for (int c = -1; c <= 1; ++c)
              for (int b = -1; b <= 1; ++b)
                for (int a = -1; a <= 1; ++a) {
                  if (value == 0 && std::abs(a) + std::abs(b) + std::abs(c) != 1) continue;
                  const std::array<int, 3> next{at[0] + a, at[1] + b, at[2] + c};
                  if (!grid.contains(next[0], next[1], next[2])) continue;
                  int& mark = flooded[grid.offset(next[0], next[1], next[2])];
                  if (mark >= 0 || labels.at(next[0], next[1], next[2]) != value) continue;
                  mark = count;
                  todo.push_back(next);
                }
          }
          ++count;
          const auto* run = runs.find(i, j, k);
          ASSERT_NE(run, nullptr);
          EXPECT_EQ(components[run->node].value, value);
          EXPECT_EQ(components[run->node].voxels, voxels);
        }
    EXPECT_EQ(components.size(), static_cast<std::size_t>(count));
  }
}

TEST(VoxelRuns, CubesAreThoseOfEveryVoxelsNeighbours) {
  std::mt19937 random(test::test_seed());
  for (int round = 0; round < 5; ++round) {
    Volume<LabelId> labels = random_blobs(random, {9, 8, 35});
    // magnify the pattern so that it contains uniform cubes
    for (int k = 0; k < 35; ++k)
      for (int j = 0; j < 8; ++j)
        for (int i = 0; i < 9; ++i) labels.at(i, j, k) = labels.at(i / 3 * 3, j / 3 * 3, k / 3 * 3);
    const auto cubes = *internal::cube_morphology(labels, 2, {}, {"cubes"});
    const auto value_at = [&](int i, int j, int k) {
      return labels.at(std::clamp(i, 0, 8), std::clamp(j, 0, 7), std::clamp(k, 0, 34));
    };
    for (int k = 0; k < 35; ++k)
      for (int j = 0; j < 8; ++j)
        for (int i = 0; i < 9; ++i) {
          bool any = false, all = true;
          for (int corner = 0; corner < 8; ++corner) {
            const int a = i - (corner & 1), b = j - (corner >> 1 & 1), c = k - (corner >> 2);
            bool one_value = true;
            for (int n = 0; n < 8; ++n)
              one_value =
                  one_value && value_at(a + (n & 1), b + (n >> 1 & 1), c + (n >> 2)) == labels.at(i, j, k);
            any = any || one_value;
            all = all && one_value;
          }
          EXPECT_EQ(cubes.thin.find(i, j, k) != nullptr, !any && labels.at(i, j, k) != 0);
          EXPECT_EQ(cubes.inner.find(i, j, k) != nullptr, all);
        }
  }
}

TEST(VoxelRuns, BitsGrowByABall) {
  std::mt19937 random(test::test_seed());
  const std::array<int, 3> dims{70, 12, 11};
  const Eigen::Vector3d spacing(0.7, 1, 1.5);
  VoxelBits bits(dims);
  std::vector<std::array<int, 3>> set;
  for (int n = 0; n < 6; ++n) {
    set.push_back({std::uniform_int_distribution(0, 69)(random), std::uniform_int_distribution(0, 11)(random),
                   std::uniform_int_distribution(0, 10)(random)});
    bits.set(set.back()[0], set.back()[1], set.back()[2]);
  }
  const auto grown = *bits.dilated(2.2, spacing, 1, {}, {"grown"});
  for (int k = 0; k < 11; ++k)
    for (int j = 0; j < 12; ++j)
      for (int i = 0; i < 70; ++i) {
        bool near = false;
        for (const auto& at : set)
          near = near || Eigen::Vector3d(i - at[0], j - at[1], k - at[2]).cwiseProduct(spacing).norm() <= 2.2;
        EXPECT_EQ(grown.at(i, j, k), near);
      }
}

}  // namespace
}  // namespace palpate
