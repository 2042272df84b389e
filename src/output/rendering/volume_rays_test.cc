#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>
#include <random>
#include <vector>

#include "base/test_seed.h"
#include "palpate/volume/volume.h"
#include "rendering/volume_encoding.h"
#include "rendering/volume_simd.h"
#include "sampling/test_targets.h"

namespace palpate {
namespace {

using internal::volume_picture::CubesView;
using internal::volume_picture::EmptySpaceMap;
using internal::volume_picture::kBlock;
using internal::volume_picture::kCubeSide;
using internal::volume_picture::kDepthSteps;
using internal::volume_picture::kGroup;
using internal::volume_picture::kNoPlane;
using internal::volume_picture::LitBlockCache;
using internal::volume_picture::RowsView;
using internal::volume_picture::SamplePlane;
using internal::volume_picture::trace_rays;
using internal::volume_picture::TracedRay;
using internal::volume_picture::VolumeEncoding;
using internal::volume_picture::VoxelBlock;

/// Rows along i with some uniformly filled blocks; buffers of minimal size, so that a sanitizer detects reads
/// beyond them.
struct Grid {
  std::array<int, 3> count;
  int blocks, words, groups;
  std::vector<std::uint64_t> mask;
  std::vector<std::uint32_t> first;
  std::vector<VoxelBlock> voxels = std::vector<VoxelBlock>(1 + kGroup);  ///< All equal but the first
  std::unique_ptr<LitBlockCache> lit = std::make_unique<LitBlockCache>();

  Grid(const std::array<int, 3>& size, std::uint16_t extinction)
      : count(size),
        blocks((size[0] + kBlock - 1) / kBlock),
        words((blocks + 63) / 64),
        groups((blocks + kGroup - 1) / kGroup) {
    const std::size_t rows = static_cast<std::size_t>(size[1]) * static_cast<std::size_t>(size[2]);
    mask.resize(rows * static_cast<std::size_t>(words));
    first.resize(rows * static_cast<std::size_t>(groups), 1);
    for (std::size_t n = 1; n < voxels.size(); ++n)
      std::fill(std::begin(voxels[n].extinction), std::end(voxels[n].extinction), extinction);
    lit->forget();
  }
  RowsView view() {
    RowsView rows;
    rows.mask = mask.data();
    rows.first = first.data();
    rows.voxels = voxels.data();
    rows.blocks = blocks;
    rows.words = words;
    rows.groups = groups;
    for (int a = 0; a < 3; ++a) rows.count[a] = count[static_cast<std::size_t>(a)];
    rows.row[1] = 1;
    rows.row[2] = count[1];
    return rows;
  }
};

TracedRay ray_from(float x, float x_per_plane, float y, float y_per_plane) {
  TracedRay ray{};
  ray.x = x, ray.x_per_plane = x_per_plane, ray.y = y, ray.y_per_plane = y_per_plane;
  ray.step = 1;
  ray.first = -kNoPlane, ray.last = kNoPlane;
  return ray;
}

/// In `float`, positions on the boundary may be rounded to beyond it.
TEST(VolumeRendererRays, StayInTheGridWhereTheyMeetItsBorders) {
  const unsigned seed = test::test_seed();
  std::printf("seed %u\n", seed);
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> pace(0.01f, 1.2f), deep(0, 1), short_of(0, 3e-4f);
  for (const std::array<int, 3>& count :
       {std::array{767, 4, 4}, {1023, 4, 4}, {1024, 4, 4}, {2048, 3, 3}, {4, 1023, 4}, {4, 2048, 3}}) {
    const int axis = count[0] > count[1] ? 0 : 1;
    const auto length = static_cast<std::size_t>(count[static_cast<std::size_t>(axis)]);
    // a read beyond a row's end returns the next row's beginning
    Grid grid(count, 4000);
    if (axis == 0)
      for (std::size_t row = 0; row < grid.mask.size(); row += static_cast<std::size_t>(grid.words))
        grid.mask[row] = 1;
    const RowsView rows = grid.view();
    GridGeometry geometry;
    geometry.dims = count;
    const EmptySpaceMap skips(geometry);
    // no skips: every plane is sampled
    const std::size_t cubes = (static_cast<std::size_t>(count[0] + 1) / 4 + 1) *
                              (static_cast<std::size_t>(count[1] + 1) / 4 + 1) *
                              (static_cast<std::size_t>(count[2] + 1) / 4 + 1);
    const std::vector<std::uint64_t> all(cubes, ~std::uint64_t{0});
    CubesView small_steps = skips.view(0, 1, 2);
    small_steps.filled = all.data();
    std::vector<SamplePlane> planes(600);
    for (SamplePlane& plane : planes) {
      plane = SamplePlane{};
      plane.slice = static_cast<int>(random() % static_cast<unsigned>(count[2]));
      plane.beyond = deep(random);
    }
    int observed = 0;
    std::vector<TracedRay> rays(20'000);
    for (std::size_t n = 0; n < rays.size(); ++n) {
      // at the boundary on an integer plane, from outside or inside, at most 8 voxels away, or slightly
      // before it
      const float border =
          n % 5 == 4 ? -1.0f + short_of(random) : static_cast<float>(length) - short_of(random);
      const auto plane = static_cast<float>(8 + random() % 580),
                 lateral = static_cast<float>(random() % static_cast<unsigned>(count[axis == 0 ? 1 : 0]));
      const float per_plane = (n % 2 == 0 ? 1.0f : -1.0f) * pace(random), start = border - per_plane * plane;
      rays[n] = axis == 0 ? ray_from(start, per_plane, lateral, 0) : ray_from(lateral, 0, start, per_plane);
      rays[n].first_filled = std::max(0.0f, plane - 6);
      rays[n].last = plane + 6;
      if (axis == 0 && border < 0) rays[n].first_filled = kNoPlane;  // the first block is filled
    }
    for (const CubesView& view : {skips.view(0, 1, 2), small_steps}) {
      std::vector<TracedRay> traced = rays;
      trace_rays(rows, view, planes.data(), static_cast<int>(planes.size()), 1, true,
                 static_cast<int>(traced.size()), traced.data(), *grid.lit);
      for (const TracedRay& ray : traced) observed += ray.transmittance == 1 ? 0 : 1;
    }
    EXPECT_EQ(observed, 0) << count[0] << " " << count[1] << " " << count[2];
  }
}

/// In a homogeneous medium transmittance reaches one half after ln 2 / extinction, not at the next plane.
TEST(VolumeRendererRays, MeetWhereHalfIsCovered) {
  for (const std::uint16_t extinction :
       std::initializer_list<std::uint16_t>{600, 1500, 5000, 20'000, 60'000}) {
    Grid grid({16, 4, 64}, extinction);
    std::fill(grid.mask.begin(), grid.mask.end(), 3u);
    std::vector<SamplePlane> planes(63);
    for (std::size_t n = 0; n < planes.size(); ++n) planes[n].slice = static_cast<int>(n);
    const std::vector<std::uint64_t> all(5ul * 2 * 17, ~std::uint64_t{0});
    CubesView cubes;
    cubes.filled = all.data();
    cubes.step[0] = 1, cubes.step[1] = 5, cubes.step[2] = 10;
    for (const float first : {-kNoPlane, 2.3f, 7.8f})
      for (const float step : {1.0f, 0.7f}) {
        TracedRay ray = ray_from(5.5f, 0.01f, 1.5f, 0);
        ray.step = step;
        ray.first = first;
        const float before = first < 0 ? -0.5f : first;
        TracedRay clipped = ray;
        trace_rays(grid.view(), cubes, planes.data(), static_cast<int>(planes.size()), 1, true, 1, &clipped,
                   *grid.lit);
        const float expected =
            before + std::log(2.0f) / (static_cast<float>(extinction) / kDepthSteps * step);
        // a clip plane within a sample's interval spreads the rest over the whole interval
        EXPECT_NEAR(clipped.half_plane, expected, first < 0 ? 2e-3f : 1.0f)
            << extinction << " " << first << " " << step;
        EXPECT_LT(clipped.transmittance, 0.5f);
      }
  }
}

/// Compared with exhaustive search over all voxels around each cell and all cubes around each cube.
TEST(VolumeRendererRays, SkipEmptySpaceOnly) {
  const unsigned seed = test::test_seed();
  std::printf("seed %u\n", seed);
  std::mt19937 random(seed);
  const auto below = [&](int end) { return static_cast<int>(random() % static_cast<unsigned>(end)); };
  GridGeometry grid;
  grid.dims = {83, 57, 71};
  Volume<LabelId> labels(grid);
  const std::vector<StructureAppearance> appearances{{{}, 0}, {{200, 100, 50}, 1}};
  VolumeEncoding encoding(grid, appearances);
  const std::array<int, 3> cubes{(83 + 1) / kCubeSide + 1, (57 + 1) / kCubeSide + 1,
                                 (71 + 1) / kCubeSide + 1};
  for (int change = 0; change < 6; ++change) {
    // first the whole grid, then boxes that are filled or emptied
    VoxelBox box{{0, 0, 0}, grid.dims};
    if (change > 0) {
      for (std::size_t a = 0; a < 3; ++a) box.size[a] = 1 + below(9), box.first[a] = below(grid.dims[a] - 9);
      for (int k = 0; k < box.size[2]; ++k)
        for (int j = 0; j < box.size[1]; ++j)
          for (int i = 0; i < box.size[0]; ++i)
            labels.at(box.first[0] + i, box.first[1] + j, box.first[2] + k) = change == 3 ? 0 : 1;
    } else {
      for (int n = 0; n < 3; ++n) labels.at(below(83), below(57), below(71)) = 1;
    }
    ASSERT_TRUE(encoding.encode(*label_bricks(labels), box, 2, {}));
    const CubesView view = encoding.skips().view(0, 1, 2);
    const auto is_filled = [&](int i, int j, int k) {
      if (i < 0 || j < 0 || k < 0 || i >= grid.dims[0] || j >= grid.dims[1] || k >= grid.dims[2])
        return false;
      const auto* block = encoding.rows_for(2).row(j, k)[i / kBlock];
      return block != nullptr && block->extinction[i % kBlock] != 0;
    };
    std::vector<std::array<int, 3>> filled;
    for (int c = 0; c < cubes[2]; ++c)
      for (int b = 0; b < cubes[1]; ++b)
        for (int a = 0; a < cubes[0]; ++a) {
          std::uint64_t expected = 0;
          for (int bit = 0; bit < 64; ++bit)
            for (int corner = 0; corner < 8; ++corner)
              if (is_filled(kCubeSide * a + bit % 4 - (corner & 1),
                            kCubeSide * b + bit / 4 % 4 - (corner >> 1 & 1),
                            kCubeSide * c + bit / 16 - (corner >> 2)))
                expected |= std::uint64_t{1} << bit;
          ASSERT_EQ(view.filled[a * view.step[0] + b * view.step[1] + c * view.step[2]], expected)
              << change << ": " << a << " " << b << " " << c;
          if (expected != 0) filled.push_back({a, b, c});
        }
    ASSERT_FALSE(filled.empty());
    for (int c = 0; c < cubes[2]; ++c)
      for (int b = 0; b < cubes[1]; ++b)
        for (int a = 0; a < cubes[0]; ++a) {
          int smallest = 12;
          for (const auto& f : filled)
            smallest =
                std::min(smallest, std::max({std::abs(f[0] - a), std::abs(f[1] - b), std::abs(f[2] - c)}));
          ASSERT_EQ(view.skip[a * view.step[0] + b * view.step[1] + c * view.step[2]], smallest)
              << change << ": " << a << " " << b << " " << c;
        }
  }
}

}  // namespace
}  // namespace palpate
