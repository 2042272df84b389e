#include <gtest/gtest.h>

#include <set>

#include "sampling/label_sphere_test_support.h"

namespace palpate {
namespace {

TEST(LabelSet, ContainsInsertedLabelsUntilErased) {
  std::mt19937 random(11);
  LabelSet set;
  std::set<unsigned> expected;
  for (int n = 0; n < 3000; ++n) {
    // dense enough for ranges, including the last label
    const auto id = static_cast<LabelId>(n % 100 == 0 ? 65535 : 1 + random() % 2000);
    if (random() % 3 == 0) {
      set.erase(id);
      expected.erase(id);
    } else {
      set.insert(id);
      expected.insert(id);
    }
  }
  for (unsigned id = 0; id < 0x10000; ++id) {
    ASSERT_EQ(set.contains(static_cast<LabelId>(id)), expected.contains(id)) << id;
  }

  // the ranges contain the same labels, and at least one label is missing between any two of them
  std::set<unsigned> in_runs;
  unsigned free_from = 0;
  for (const LabelRange& range : set.ranges()) {
    ASSERT_GT(range.first, free_from);
    for (unsigned id = range.first; id <= range.last; ++id) in_runs.insert(id);
    free_from = range.last + 1u;
  }
  EXPECT_EQ(in_runs, expected);
}

TEST(LabelSet, AllIsOneRangeWithoutBackground) {
  const auto ranges = LabelSet::all().ranges();
  ASSERT_EQ(ranges.size(), 1u);
  EXPECT_EQ(ranges[0].first, 1);
  EXPECT_EQ(ranges[0].last, 65535);
  EXPECT_FALSE(LabelSet::all().contains(0));
  EXPECT_TRUE(LabelSet().ranges().empty());
}

TEST(LabelSetDeathTest, RejectsBackground) {
  EXPECT_DEATH(LabelSet{0}, "check 'id != 0' failed");
}

TEST(LabelVoxels, MembershipIsEqualInLabelsAndMask) {
  std::mt19937 random(5);
  const GridGeometry grid = test::make_grid({9, 7, 5}, 3);
  const auto labels = internal::random_labels(grid, random);
  for (const LabelSet& set : {LabelSet{1}, LabelSet{2, 3, 40000}, LabelSet::all(), LabelSet()}) {
    const LabelVoxels direct(labels, set), mask = LabelVoxels::mask(*labels, set);
    EXPECT_EQ(direct.bytes_per_voxel(), 2);
    EXPECT_EQ(mask.bytes_per_voxel(), 1);
    EXPECT_TRUE(mask.geometry().same_grid(grid));
    for (int k = -1; k <= 5; ++k) {
      for (int j = -1; j <= 7; ++j) {
        for (int i = -1; i <= 9; ++i) {
          const bool expected = set.contains(labels->anywhere(i, j, k));
          ASSERT_EQ(direct.contains(i, j, k), expected);
          ASSERT_EQ(mask.contains(i, j, k), expected);
        }
      }
    }
  }
}

}  // namespace
}  // namespace palpate
