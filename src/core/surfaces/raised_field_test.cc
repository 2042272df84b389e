#include "surfaces/raised_field.h"

#include <gtest/gtest.h>

#include <random>

#include "base/test_seed.h"
#include "surfaces/test_surface_shapes.h"

namespace palpate::internal {
namespace {

TEST(RaisedField, EqualsTheDenseField) {
  const auto seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  const auto any = [&](int low, int high) { return std::uniform_int_distribution<int>(low, high)(random); };
  for (int n = 0; n < 30; ++n) {
    const GridGeometry grid = test::surface_grid({any(1, 150), any(1, 40), any(1, 6)}, {1, 1, 1});
    Volume<std::uint16_t> dense(grid);
    RaisedField field(grid);
    for (int times = 0; times < 12; ++times) {
      Span3 box;
      for (int a = 0; a < 3; ++a) {
        box.low[a] = any(0, grid.dims[a] - 1);
        box.high[a] = any(box.low[a] + 1, grid.dims[a]);
      }
      // a uniform value, above 0 everywhere, or sparse
      const int kind = any(0, 2);
      std::vector<std::uint16_t> values(static_cast<std::size_t>(box.size(0)) *
                                        static_cast<std::size_t>(box.size(1)));
      for (int k = box.low[2]; k < box.high[2]; ++k) {
        const auto one = static_cast<std::uint16_t>(any(0, 65535));
        std::size_t at = 0;
        for (int j = box.low[1]; j < box.high[1]; ++j) {
          for (int i = box.low[0]; i < box.high[0]; ++i, ++at) {
            values[at] = kind == 0                     ? one
                         : kind == 1 || any(0, 9) == 0 ? static_cast<std::uint16_t>(any(1, 65535))
                                                       : 0;
            dense.at(i, j, k) = std::max(dense.at(i, j, k), values[at]);
          }
        }
        field.raise(k, box, values.data());
      }
    }
    const Bricks<std::uint16_t> made = field.take();
    EXPECT_EQ(made.content_hash(), Bricks<std::uint16_t>(dense, 0).content_hash());
    EXPECT_TRUE(made.dense().voxels() == dense.voxels());
  }
}

}  // namespace
}  // namespace palpate::internal
