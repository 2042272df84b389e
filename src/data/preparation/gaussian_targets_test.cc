#include <gtest/gtest.h>

#include "base/test_seed.h"
#include "palpate/volume/simd_targets.h"
#include "preparation/test_gaussian_volumes.h"
#include "sampling/test_targets.h"

namespace palpate {
namespace {

TEST(SimdTargets, AreNamedBestFirst) {
  const auto names = simd_targets();
  const auto targets = hwy::SupportedAndGeneratedTargets();
  ASSERT_FALSE(names.empty());
  ASSERT_EQ(names.size(), targets.size());
  EXPECT_EQ(names.front(), hwy::TargetName(targets.front()));
  const test::OnlyTargets only(targets.back());
  EXPECT_EQ(simd_targets(), std::vector<std::string>{names.back()});
}

TEST(SimdTargets, GiveTheSameBits) {
  const auto seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  for (const auto& dims : {std::array{150, 9, 7}, std::array{67, 5, 6}, std::array{16, 4, 4},
                           std::array{5, 7, 3}, std::array{1, 11, 2}}) {
    const GridGeometry grid = internal::test_grid(dims, {0.625, 0.625, 0.9});
    const auto bytes = internal::random_bytes(grid, random);
    const auto floats = internal::random_floats(grid, random);
    const GaussianOptions options{.sigma_mm = 1.5, .threads = 1};
    const auto smooth_bytes = gaussian_smooth(bytes, options);
    const auto smooth_words = gaussian_smooth_16(bytes, options);
    const auto smooth_floats = gaussian_smooth(floats, options);

    for (const std::int64_t target : test::all_targets()) {
      SCOPED_TRACE(test::target_name(target));
      const test::OnlyTargets only(target);
      EXPECT_EQ(gaussian_smooth(bytes, options)->voxels(), smooth_bytes->voxels());
      EXPECT_EQ(gaussian_smooth_16(bytes, options)->voxels(), smooth_words->voxels());
      EXPECT_EQ(gaussian_smooth(floats, options)->voxels(), smooth_floats->voxels());
    }
  }
}

}  // namespace
}  // namespace palpate
