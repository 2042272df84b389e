#include "surfaces/pieces.h"

#include <gtest/gtest.h>

#include <random>

#include "base/test_seed.h"

namespace palpate::internal {
namespace {

TEST(Pieces, CoverTheBoxOnceWithBoundedMargins) {
  const auto seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  const auto any = [&](int low, int high) { return std::uniform_int_distribution<int>(low, high)(random); };
  int cut = 0;
  for (int n = 0; n < 200; ++n) {
    // an unusually large number of columns, so that strips are sometimes needed
    const Span3 box{{any(-5, 5), any(-5, 5), any(-5, 5)}, {any(5, 3000), any(5, 700), any(5, 90)}};
    const PieceMargins margins{{any(0, 50), any(0, 50), any(0, 50)}, {any(0, 150), any(0, 150), any(0, 150)}};
    const int threads = any(1, 40);
    const Pieces pieces = cut_into_pieces(box, margins, threads);
    EXPECT_GE(pieces.workers, 1);
    EXPECT_LE(pieces.workers, threads);
    std::vector<int> covered(static_cast<std::size_t>(box.size(1)) * static_cast<std::size_t>(box.size(2)));
    for (const Span3& piece : pieces.all) {
      EXPECT_EQ(piece.low[0], box.low[0]);
      EXPECT_EQ(piece.high[0], box.high[0]);
      EXPECT_LE(piece.size(2), slices_of_piece(margins));
      cut += piece.size(1) < box.size(1);
      for_each_row(piece, [&](int j, int k) {
        ++covered[static_cast<std::size_t>(k - box.low[2]) * static_cast<std::size_t>(box.size(1)) +
                  static_cast<std::size_t>(j - box.low[1])];
      });
      const double filtered = static_cast<double>(piece.grown(margins.filtered).count());
      EXPECT_TRUE(piece.size(1) <= 64 || 16 * filtered <= 1 << 30) << filtered;
    }
    EXPECT_TRUE(std::all_of(covered.begin(), covered.end(), [](int times) { return times == 1; }));
  }
  EXPECT_GT(cut, 100);
  EXPECT_TRUE(cut_into_pieces({}, {}, 2).all.empty());
  // a volume of the usual size is cut into slabs only
  EXPECT_EQ(cut_into_pieces({{0, 0, 0}, {320, 320, 300}}, {{15, 15, 15}, {30, 30, 30}}, 2).all.size(), 13u);
}

}  // namespace
}  // namespace palpate::internal
