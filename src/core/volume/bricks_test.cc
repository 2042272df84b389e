#include "palpate/volume/bricks.h"

#include <gtest/gtest.h>

#include <random>
#include <set>

#include "volume/test_grids.h"

namespace palpate {
namespace {

using testing::grid;

GridGeometry any_grid(std::mt19937& random) {
  std::uniform_int_distribution<int> size(1, 50);
  return grid({size(random), size(random), size(random)}, {0.5, 0.6, 0.9}, Eigen::Matrix3d::Identity(), {});
}

/// Volume with large regions of one value, and some in which every voxel differs.
template <class T>
Volume<T> any_volume(const GridGeometry& grid, std::mt19937& random) {
  Volume<T> volume(grid, T{3});
  std::uniform_int_distribution<int> value(0, 200);
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i)
        if ((i / 20 + j / 20 + k / 20) % 2 != 0) volume.at(i, j, k) = static_cast<T>(value(random));
  return volume;
}

template <class T>
PatchOf<T> any_patch(const GridGeometry& grid, std::mt19937& random) {
  PatchOf<T> patch;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    patch.box.first[axis] = std::uniform_int_distribution<int>(0, grid.dims[axis] - 1)(random);
    patch.box.size[axis] =
        std::uniform_int_distribution<int>(0, grid.dims[axis] - patch.box.first[axis])(random);
  }
  // sometimes a single value, so that bricks become uniform
  const bool plain = random() % 3 == 0;
  for (std::size_t n = patch.box.voxel_count(); n > 0; --n)
    patch.values.push_back(static_cast<T>(plain ? 3 : random() % 200));
  return patch;
}

/// Applies a patch voxel by voxel.
template <class T>
void write(const PatchOf<T>& patch, Volume<T>& volume) {
  std::size_t n = 0;
  const auto& [first, size] = patch.box;
  for (int k = 0; k < size[2]; ++k)
    for (int j = 0; j < size[1]; ++j)
      for (int i = 0; i < size[0]; ++i)
        volume.at(first[0] + i, first[1] + j, first[2] + k) = patch.values[n++];
}

template <class T>
void expect_holds(const Bricks<T>& bricks, const Volume<T>& volume) {
  ASSERT_EQ(bricks.geometry().dims, volume.geometry().dims);
  constexpr int kBorder = BrickLayout::kBorder;
  const auto& dims = volume.geometry().dims;
  const BrickView<T> view = bricks.view();
  // range that a query may read around this voxel
  const auto near = [](int at, int count) {
    return std::pair{std::max(at - 1, -kBorder), std::min(at + 2, count + kBorder - 1)};
  };
  long wrong = 0;
  for (int k = -kBorder; k < dims[2] + kBorder; ++k)
    for (int j = -kBorder; j < dims[1] + kBorder; ++j)
      for (int i = -kBorder; i < dims[0] + kBorder; ++i) {
        const T* const cell = view.cell(i, j, k);
        const auto [i0, i1] = near(i, dims[0]);
        const auto [j0, j1] = near(j, dims[1]);
        const auto [k0, k1] = near(k, dims[2]);
        for (int w = k0; w <= k1; ++w)
          for (int v = j0; v <= j1; ++v)
            for (int u = i0; u <= i1; ++u)
              wrong += cell[(u - i) + (v - j) * BrickLayout::kRow + (w - k) * BrickLayout::kSlice] !=
                       volume.at_or(u, v, w, bricks.outside());
      }
  EXPECT_EQ(wrong, 0);
  EXPECT_TRUE(bricks.dense().voxels() == volume.voxels());
}

template <class T>
class BricksOf : public ::testing::Test {};
using Voxels = ::testing::Types<std::uint8_t, std::uint16_t, std::int16_t, float>;
TYPED_TEST_SUITE(BricksOf, Voxels);

TYPED_TEST(BricksOf, HoldAVolumeAndItsBorder) {
  std::mt19937 random(1);
  for (int n = 0; n < 6; ++n) {
    SCOPED_TRACE("seed 1, volume " + std::to_string(n));
    const auto volume = any_volume<TypeParam>(any_grid(random), random);
    expect_holds(Bricks<TypeParam>(volume, TypeParam{7}), volume);
  }
  expect_holds(Bricks<TypeParam>(), Volume<TypeParam>());
}

TYPED_TEST(BricksOf, AVersionIsWhatThePatchedVolumeWouldBe) {
  std::mt19937 random(2);
  for (int n = 0; n < 6; ++n) {
    SCOPED_TRACE("seed 2, volume " + std::to_string(n));
    const GridGeometry grid = any_grid(random);
    auto volume = any_volume<TypeParam>(grid, random);
    Bricks<TypeParam> bricks(volume, TypeParam{7});
    for (int edit = 0; edit < 4; ++edit) {
      const auto patch = any_patch<TypeParam>(grid, random);
      const Bricks<TypeParam> before = bricks;
      const Volume<TypeParam> volume_before = volume;
      write(patch, volume);
      bricks = bricks.with(patch);
      expect_holds(bricks, volume);
      EXPECT_EQ(bricks.content_hash(), Bricks<TypeParam>(volume, TypeParam{7}).content_hash());
      EXPECT_TRUE(before.dense().voxels() == volume_before.voxels()) << "an older version changed";
    }
  }
}

TYPED_TEST(BricksOf, AMarginStandsInForWhatIsOutside) {
  std::mt19937 random(3);
  const GridGeometry inner = grid({18, 5, 33}, {1, 1, 1}, Eigen::Matrix3d::Identity(), {});
  GridGeometry wide = inner;
  for (int& n : wide.dims) n += 4;
  const auto volume = any_volume<TypeParam>(wide, random);
  const Bricks<TypeParam> bricks(inner, volume, 2, TypeParam{7});
  long wrong = 0;
  for (int k = -4; k < 37; ++k)
    for (int j = -4; j < 9; ++j)
      for (int i = -4; i < 22; ++i)
        wrong += bricks.at(i, j, k) != volume.at_or(i + 2, j + 2, k + 2, TypeParam{7});
  EXPECT_EQ(wrong, 0);
}

TEST(Bricks, VersionsShareUnchangedBricks) {
  const GridGeometry cube = grid({100, 100, 100}, {1, 1, 1}, Eigen::Matrix3d::Identity(), {});
  std::mt19937 random(4);
  Volume<std::int16_t> volume(cube);
  for (auto& voxel : volume.voxels()) voxel = static_cast<std::int16_t>(random());
  const Bricks<std::int16_t> once(volume, 0);
  PatchOf<std::int16_t> patch{{{26, 26, 26}, {10, 10, 10}}, std::vector<std::int16_t>(1000, 5)};
  const Bricks<std::int16_t> again = once.with(patch);
  const auto& counts = once.counts();
  int other = 0;
  for (std::size_t n = 0; n < static_cast<std::size_t>(counts[0] * counts[1] * counts[2]); ++n)
    other += once.brick(n) != again.brick(n);
  // cells 24 ... 36 read the box, and bricks begin at cells 12, 28 and 44
  EXPECT_EQ(other, 8);

  // writing the same values again: no brick is copied
  const Bricks<std::int16_t> same = again.with(patch);
  for (std::size_t n = 0; n < static_cast<std::size_t>(counts[0] * counts[1] * counts[2]); ++n)
    EXPECT_EQ(same.brick(n), again.brick(n));
}

TEST(Bricks, ChangedBoxContainsAllDifferences) {
  std::mt19937 random(11);
  int changed = 0;
  for (int number = 0; number < 60; ++number) {
    const GridGeometry some = any_grid(random);
    const Bricks<LabelId> once(any_volume<LabelId>(some, random), 0);
    const auto patch = any_patch<LabelId>(some, random);
    const Bricks<LabelId> again = once.with(patch);
    const VoxelBox box = box_of_changes(once, again);
    EXPECT_EQ(box_of_changes(again, once), box);
    const auto is_in = [](const VoxelBox& b, const std::array<int, 3>& at) {
      for (std::size_t axis = 0; axis < 3; ++axis)
        if (at[axis] < b.first[axis] || at[axis] >= b.first[axis] + b.size[axis]) return false;
      return true;
    };
    for (int k = 0; k < some.dims[2]; ++k)
      for (int j = 0; j < some.dims[1]; ++j)
        for (int i = 0; i < some.dims[0]; ++i) {
          if (once.at(i, j, k) == again.at(i, j, k)) continue;
          ++changed;
          ASSERT_TRUE(is_in(box, {i, j, k})) << number;
        }
    // and not much larger
    for (std::size_t axis = 0; axis < 3 && box.voxel_count() > 0; ++axis) {
      EXPECT_GE(box.first[axis], std::max(0, patch.box.first[axis] - 20)) << number;
      EXPECT_LE(box.first[axis] + box.size[axis],
                std::min(some.dims[axis], patch.box.first[axis] + patch.box.size[axis] + 20))
          << number;
    }
    EXPECT_EQ(box_of_changes(once, once).voxel_count(), 0u);
  }
  EXPECT_GT(changed, 1000);
}

TEST(Bricks, UniformBricksAreStoredOnce) {
  const GridGeometry cube = grid({200, 200, 200}, {1, 1, 1}, Eigen::Matrix3d::Identity(), {});
  const Bricks<std::uint16_t> none(Volume<std::uint16_t>(cube), 0);
  EXPECT_LT(none.bytes(), 200 * 200 * 200 / 50);

  // a cube costs the memory of its surface, even when filled and cleared over many versions
  const PatchOf<std::uint16_t> filled{{{50, 50, 50}, {90, 90, 90}},
                                      std::vector<std::uint16_t>(std::size_t{90} * 90 * 90, 9)};
  PatchOf<std::uint16_t> emptied = filled;
  std::fill(emptied.values.begin(), emptied.values.end(), std::uint16_t{0});
  Bricks<std::uint16_t> now = none.with(filled);
  const std::size_t bytes = now.bytes();
  EXPECT_GT(bytes, none.bytes());
  for (int n = 0; n < 5; ++n) {
    now = now.with(emptied);
    EXPECT_EQ(now.bytes(), none.bytes());
    EXPECT_EQ(now.content_hash(), none.content_hash());
    now = now.with(filled);
    EXPECT_EQ(now.bytes(), bytes);
  }
}

TEST(Bricks, ThinVolumesUseLittleMemory) {
  for (const auto& dims : {std::array{1000, 1000, 1}, std::array{1'000'000, 1, 1}}) {
    const GridGeometry thin = grid(dims, {1, 1, 1}, Eigen::Matrix3d::Identity(), {});
    const Volume<std::int16_t> volume(thin, 5);
    const Bricks<std::int16_t> bricks(volume, 9);
    EXPECT_LT(bricks.bytes(), 2 * volume.voxels().size() * sizeof(std::int16_t));
    EXPECT_TRUE(bricks.dense().voxels() == volume.voxels());
  }
}

// a burr's session: small changes at random places, older versions released
TEST(Bricks, MemoryDoesNotGrowWithVersions) {
  std::mt19937 random(5);
  const GridGeometry cube = grid({60, 60, 60}, {1, 1, 1}, Eigen::Matrix3d::Identity(), {});
  Volume<std::int16_t> volume(cube, 100);
  Bricks<std::int16_t> now(volume, 0);
  std::uniform_int_distribution<int> coordinate(0, 55), edge(1, 5), value(0, 3);
  for (int n = 0; n < 10'000; ++n) {
    PatchOf<std::int16_t> patch{{{coordinate(random), coordinate(random), coordinate(random)}, {}}, {}};
    for (int& size : patch.box.size) size = edge(random);
    patch.values.assign(patch.box.voxel_count(), static_cast<std::int16_t>(100 * value(random)));
    write(patch, volume);
    now = now.with(patch);
  }
  const Bricks<std::int16_t> at_once(volume, 0);
  EXPECT_TRUE(now.dense().voxels() == volume.voxels()) << "seed 5";
  EXPECT_EQ(now.content_hash(), at_once.content_hash());
  // equal bricks created by successive versions are not deduplicated
  EXPECT_LE(now.bytes(), at_once.bytes() + 5 * (sizeof(std::int16_t) * BrickLayout::kStored + 64));
}

TEST(Bricks, RemovedValuesFreeTheirMemory) {
  const GridGeometry cube = grid({60, 60, 60}, {1, 1, 1}, Eigen::Matrix3d::Identity(), {});
  Bricks<std::uint16_t> now(Volume<std::uint16_t>(cube), 0);
  PatchOf<std::uint16_t> patch{{{0, 0, 0}, cube.dims}, {}};
  std::size_t of_the_first = 0;
  for (std::uint16_t value = 1; value < 50; ++value) {
    patch.values.assign(patch.box.voxel_count(), value);
    now = now.with(patch);
    if (value == 1) of_the_first = now.bytes();
    EXPECT_EQ(now.bytes(), of_the_first) << "after " << value << " values";
  }
}

TEST(Bricks, MappedLabelsEqualATableLookup) {
  std::mt19937 random(6);
  for (int n = 0; n < 6; ++n) {
    SCOPED_TRACE("seed 6, volume " + std::to_string(n));
    const auto labels = any_volume<LabelId>(any_grid(random), random);
    // few values, so that other bricks become uniform
    std::vector<std::uint8_t> value_of(65536);
    for (auto& value : value_of) value = static_cast<std::uint8_t>(random() % 20 == 0 ? random() % 3 : 1);
    Volume<std::uint8_t> values(labels.geometry());
    for (std::size_t v = 0; v < values.voxels().size(); ++v)
      values.voxels()[v] = value_of[labels.voxels()[v]];
    const Bricks<std::uint8_t> at_once(values, value_of[7]);
    const auto mapped = Bricks<std::uint8_t>::of_labels(Bricks<LabelId>(labels, LabelId{7}), value_of);
    expect_holds(mapped, values);
    EXPECT_EQ(mapped.outside(), at_once.outside());
    EXPECT_EQ(mapped.content_hash(), at_once.content_hash());
  }
}

TEST(Bricks, PiecesEqualTheVolume) {
  std::mt19937 random(7);
  int uniform = 0;
  for (int n = 0; n < 6; ++n) {
    SCOPED_TRACE("seed 7, volume " + std::to_string(n));
    const auto volume = any_volume<std::uint16_t>(any_grid(random), random);
    const Bricks<std::uint16_t> bricks(volume, 3);
    std::vector<std::uint16_t> observed;
    long wrong = 0;
    bricks.for_each_piece([&](const RowPiece<std::uint16_t>& piece) {
      EXPECT_EQ(volume.geometry().offset(piece.i, piece.j, piece.k), observed.size());
      observed.insert(observed.end(), piece.voxels, piece.voxels + piece.count);
      // neighbours of the piece
      for (int d = -1; d <= 1; ++d)
        for (int e = -1; e <= 1; ++e)
          for (int i = -1; i <= piece.count; ++i) {
            const auto there = piece.voxels[i + d * BrickLayout::kRow + e * BrickLayout::kSlice];
            wrong += there != volume.at_or(piece.i + i, piece.j + d, piece.k + e, 3);
            wrong += piece.uniform && there != *piece.voxels;
          }
      uniform += piece.uniform;
    });
    EXPECT_EQ(wrong, 0);
    EXPECT_TRUE(observed == volume.voxels());
  }
  EXPECT_GT(uniform, 0);
}

TEST(Bricks, SlicesBuildTheSameBricksAsAVolume) {
  std::mt19937 random(5);
  for (int n = 0; n < 40; ++n) {
    const GridGeometry grid = any_grid(random);
    const auto volume = any_volume<std::int16_t>(grid, random);
    const Bricks<std::int16_t> whole(volume, 7);
    BricksBuilder<std::int16_t> slices(grid, 7);
    const int largest = std::uniform_int_distribution<int>(1, 45)(random);
    for (int k = 0; k < grid.dims[2];) {
      const int count = std::uniform_int_distribution<int>(0, std::min(largest, grid.dims[2] - k))(random);
      if (count > 0) slices.add(count, &volume.at(0, 0, k));
      k += count;
    }
    const Bricks<std::int16_t> made = slices.take();
    expect_holds(made, volume);
    EXPECT_EQ(made.content_hash(), whole.content_hash());
    EXPECT_EQ(made.bytes(), whole.bytes());
    EXPECT_EQ(made.outside(), 7);
  }
  const GridGeometry none;
  EXPECT_EQ(BricksBuilder<float>(none, 2).take().content_hash(),
            Bricks<float>(Volume<float>(none), 2).content_hash());
}

TEST(Bricks, AnyCoordinateCanBeQueried) {
  std::mt19937 random(9);
  const auto volume = any_volume<std::int16_t>(any_grid(random), random);
  const Bricks<std::int16_t> bricks(volume, 7);
  for (int n = 0; n < 5000; ++n) {
    std::array<int, 3> p;
    for (std::size_t axis = 0; axis < 3; ++axis)
      p[axis] = std::uniform_int_distribution<int>(-40, volume.geometry().dims[axis] + 40)(random);
    EXPECT_EQ(bricks.anywhere(p[0], p[1], p[2]), volume.at_or(p[0], p[1], p[2], 7)) << "seed 9";
  }
}

TEST(Bricks, LabelsAreCounted) {
  std::mt19937 random(8);
  for (int n = 0; n < 6; ++n) {
    SCOPED_TRACE("seed 8, volume " + std::to_string(n));
    const auto labels = any_volume<LabelId>(any_grid(random), random);
    std::vector<std::size_t> counts(65536);
    for (const LabelId label : labels.voxels()) ++counts[label];
    EXPECT_EQ(label_counts(Bricks<LabelId>(labels, 9)), counts);
  }
  EXPECT_EQ(label_counts(Bricks<LabelId>()), std::vector<std::size_t>(65536));
}

}  // namespace
}  // namespace palpate
