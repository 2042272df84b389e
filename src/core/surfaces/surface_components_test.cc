#include "surfaces/surface_components.h"

#include <gtest/gtest.h>

#include <map>
#include <random>

#include "base/test_seed.h"
#include "surfaces/test_surface_shapes.h"

namespace palpate::internal {
namespace {

/// Sizes of the components by flood fill over 26 neighbours, in the order of their first voxels.
std::vector<std::size_t> flood_fill(Volume<LabelId> labels, LabelId label) {
  const GridGeometry grid = labels.geometry();
  std::vector<std::size_t> sizes;
  std::vector<Index3> open;
  const auto visit = [&](int i, int j, int k) {
    if (labels.at_or(i, j, k, 0) != label) return;
    labels.at(i, j, k) = 0;
    open.push_back({i, j, k});
    ++sizes.back();
  };
  for_each_row(full_span(grid), [&](int j, int k) {
    for (int i = 0; i < grid.dims[0]; ++i) {
      if (labels.at(i, j, k) != label) continue;
      sizes.push_back(0);
      visit(i, j, k);
      while (!open.empty()) {
        const Index3 v = open.back();
        open.pop_back();
        for (int n = 0; n < 27; ++n) visit(v[0] + n % 3 - 1, v[1] + n / 3 % 3 - 1, v[2] + n / 9 - 1);
      }
    }
  });
  return sizes;
}

TEST(SurfaceComponents, EqualFloodFillOverTwentySixNeighbours) {
  const auto seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  for (const Index3& dims : {Index3{17, 13, 9}, Index3{1, 9, 7}, Index3{30, 1, 1}, Index3{5, 5, 1}}) {
    for (const double fill : {0.02, 0.08, 0.15, 0.4, 1.0}) {
      Volume<LabelId> labels(test::surface_grid(dims, {1, 1, 1}));
      std::bernoulli_distribution set(fill);
      for (LabelId& v : labels.voxels())
        v = set(random) ? static_cast<LabelId>(1 + random() % 2) : LabelId{0};
      const auto spans = label_spans(*label_bricks(labels));
      for (const LabelId label : {LabelId{1}, LabelId{2}}) {
        const Components found = find_components(*label_bricks(labels), label, spans[label]);
        std::vector<std::size_t> sizes;
        for (const Component& c : found.all) sizes.push_back(c.voxels);
        EXPECT_EQ(sizes, flood_fill(labels, label));
        std::map<std::uint32_t, std::size_t> by_runs;
        for (const LabelRun& run : found.runs) by_runs[run.component] += run.last - run.first + 1;
        for (std::size_t n = 0; n < sizes.size(); ++n)
          EXPECT_EQ(by_runs[static_cast<std::uint32_t>(n)], sizes[n]);
      }
    }
  }
}

TEST(SurfaceComponents, ReportTheirPositions) {
  Volume<LabelId> labels(test::surface_grid({9, 8, 7}, {1, 1, 1}));
  labels.at(1, 2, 3) = labels.at(2, 3, 4) = labels.at(2, 4, 4) = 5;  // connected by a corner, by a face
  const Components found = find_components(*label_bricks(labels), 5, label_spans(*label_bricks(labels))[5]);
  ASSERT_EQ(found.all.size(), 1u);
  EXPECT_EQ(found.all[0].span.low, (Index3{1, 2, 3}));
  EXPECT_EQ(found.all[0].span.high, (Index3{3, 5, 5}));
  EXPECT_EQ(found.all[0].index_sum, Eigen::Vector3d(5, 9, 11));
}

}  // namespace
}  // namespace palpate::internal
