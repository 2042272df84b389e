#include "server/redacted_labels.h"

#include <gtest/gtest.h>

#include <functional>

namespace palpate::server {
namespace {

constexpr LabelId kHidden = 9;

Volume<LabelId> painted(const std::array<int, 3>& dims,
                        const std::function<LabelId(int, int, int)>& label_at) {
  GridGeometry grid;
  grid.dims = dims;
  Volume<LabelId> labels(grid);
  for (int k = 0; k < dims[2]; ++k)
    for (int j = 0; j < dims[1]; ++j)
      for (int i = 0; i < dims[0]; ++i) labels.at(i, j, k) = label_at(i, j, k);
  return labels;
}

Volume<LabelId> redacted(const Volume<LabelId>& labels,
                         const std::vector<LabelId>& hidden_labels = {kHidden}) {
  std::vector<bool> hidden(std::size_t{1} << 16);
  for (const LabelId label : hidden_labels) hidden[label] = true;
  return redacted_labels(label_bricks(labels), hidden)->dense();
}

/// Number of voxels that differ from the original after a ball has been hidden and filled.
std::size_t wrong(const Volume<LabelId>& truth, const Eigen::Vector3d& centre, double radius,
                  bool in_air_too) {
  Volume<LabelId> labels = truth;
  const auto& dims = truth.geometry().dims;
  for (int k = 0; k < dims[2]; ++k)
    for (int j = 0; j < dims[1]; ++j)
      for (int i = 0; i < dims[0]; ++i)
        if ((Eigen::Vector3d(i, j, k) - centre).norm() <= radius && (in_air_too || truth.at(i, j, k) != 0))
          labels.at(i, j, k) = kHidden;
  const Volume<LabelId> shown = redacted(labels);
  std::size_t count = 0;
  for (std::size_t n = 0; n < shown.voxels().size(); ++n) count += shown.voxels()[n] != truth.voxels()[n];
  return count;
}

TEST(RedactedLabels, ABallInOneStructureBecomesIt) {
  const auto block = painted({20, 20, 20}, [](int, int, int) { return LabelId{4}; });
  EXPECT_EQ(wrong(block, {9, 10, 8}, 5.5, false), 0u);
}

TEST(RedactedLabels, StructuresBorderingAirAreNotLabelledAir) {
  // half a ball on top of a structure: more faces to air than to the structure
  const auto labels = painted({20, 20, 20}, [](int i, int j, int k) {
    const bool in_ball = (i - 10) * (i - 10) + (j - 10) * (j - 10) + (k - 10) * (k - 10) <= 16;
    return LabelId(k < 10 ? 4 : in_ball ? kHidden : 0);
  });
  const Volume<LabelId> shown = redacted(labels);
  for (std::size_t n = 0; n < labels.voxels().size(); ++n)
    ASSERT_EQ(shown.voxels()[n], labels.voxels()[n] == kHidden ? 4 : labels.voxels()[n]);
}

TEST(RedactedLabels, ThinLayerContinuesOverItsSupport) {
  // a layer of 3 voxels between bone and air: a half ball of radius 3.5 mostly touches bone and air
  const auto layer = painted({24, 24, 24}, [](int, int, int k) {
    return LabelId(k < 10 ? 7 : k < 13 ? 4 : 0);
  });
  Volume<LabelId> labels = layer;
  for (std::size_t n = 0; n < labels.voxels().size(); ++n) {
    const int i = static_cast<int>(n % 24) - 12, j = static_cast<int>(n / 24 % 24) - 12,
              k = static_cast<int>(n / 576) - 12;
    if (layer.voxels()[n] == 4 && i * i + j * j + k * k <= 25) labels.voxels()[n] = kHidden;
  }
  EXPECT_EQ(redacted(labels).voxels(), layer.voxels());
}

TEST(RedactedLabels, BorderContinuesThroughTheHiddenStructure) {
  const auto plane = painted({24, 24, 24}, [](int, int, int k) { return LabelId(k < 12 ? 7 : 4); });
  EXPECT_EQ(wrong(plane, {12, 12, 12}, 5.2, false), 0u);
  const auto tilted = painted({24, 24, 24}, [](int i, int, int k) { return LabelId(k + i < 24 ? 7 : 4); });
  EXPECT_EQ(wrong(tilted, {12, 12, 12}, 5.2, false), 0u);
}

TEST(RedactedLabels, OnlyRegionsSurroundedByAirBecomeAir) {
  const auto labels = painted({12, 12, 12}, [](int i, int j, int k) {
    const bool is_alone = i > 7 && j > 3 && j < 6 && k > 3 && k < 6 && i < 10;
    return LabelId(is_alone ? kHidden : i < 4 ? 4 : i < 5 && j == 5 && k == 5 ? kHidden : 0);
  });
  const Volume<LabelId> shown = redacted(labels);
  EXPECT_EQ(shown.at(8, 4, 4), 0);
  EXPECT_EQ(shown.at(4, 5, 5), 4) << "one face of six is enough";
}

TEST(RedactedLabels, IsIndependentOfAxisAndStructureOrder) {
  const auto at = [](int i, int j, int k) {
    const bool in_ball = (i - 8) * (i - 8) + (j - 8) * (j - 8) + (k - 8) * (k - 8) <= 20;
    return LabelId(in_ball ? (i < 8 ? kHidden : kHidden + 1) : k < 7 ? 7 : j < 9 ? 4 : 0);
  };
  const auto plain = redacted(painted({16, 16, 16}, at), {kHidden, kHidden + 1});
  const auto swapped = redacted(painted({16, 16, 16}, [&](int k, int j, int i) { return at(i, j, k); }),
                                {kHidden, kHidden + 1});
  for (int k = 0; k < 16; ++k)
    for (int j = 0; j < 16; ++j)
      for (int i = 0; i < 16; ++i)
        ASSERT_EQ(plain.at(i, j, k), swapped.at(k, j, i)) << i << " " << j << " " << k;
}

TEST(RedactedLabels, NothingHiddenIsTheSameObject) {
  const auto labels = label_bricks(painted({5, 5, 5}, [](int, int, int) { return LabelId{1}; }));
  EXPECT_EQ(redacted_labels(labels, std::vector<bool>(std::size_t{1} << 16)), labels);
}

}  // namespace
}  // namespace palpate::server
