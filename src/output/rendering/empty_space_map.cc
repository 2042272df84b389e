#include "rendering/empty_space_map.h"

#include <algorithm>
#include <vector>

namespace palpate::internal::volume_picture {
namespace {

// Maximum skip, in cubes, which bounds the region affected by a change.
constexpr std::uint8_t kMaxSkip = 12;

}  // namespace

EmptySpaceMap::EmptySpaceMap(const GridGeometry& grid) : voxels_(grid.dims) {
  // cells 0 ... voxels, and one more, to which positions at the border may be rounded
  for (std::size_t a = 0; a < 3; ++a) cubes_[a] = (voxels_[a] + 1) / kCubeSide + 1;
  skip_.resize(static_cast<std::size_t>(cubes_[0]) * cubes_[1] * cubes_[2], kMaxSkip);
  filled_.resize(skip_.size());
}

void EmptySpaceMap::fill(const BlockRows& rows, const Cubes& cubes) {
  for (int c = cubes[2][0]; c <= cubes[2][1]; ++c)
    for (int b = cubes[1][0]; b <= cubes[1][1]; ++b)
      std::fill_n(filled_.begin() + static_cast<std::ptrdiff_t>(index(cubes[0][0], b, c)),
                  cubes[0][1] - cubes[0][0] + 1, 0);
  // cell n lies between voxels n - 1 and n
  const auto first = [&](std::size_t axis) { return std::max(0, cubes[axis][0] * kCubeSide - 1); };
  const auto end = [&](std::size_t axis) {
    return std::min(voxels_[axis], (cubes[axis][1] + 1) * kCubeSide);
  };
  const auto within = [&](int cube, std::size_t axis) {
    return cube >= cubes[axis][0] && cube <= cubes[axis][1];
  };
  constexpr int kLast = kCubeSide - 1;
  for (int k = first(2); k < end(2); ++k)
    for (int j = first(1); j < end(1); ++j) {
      const BlockRows::Row row = rows.row(j, k);
      for (int block = first(0) / kBlock; block * kBlock < end(0); ++block) {
        const VoxelBlock* voxels = row[block];
        if (voxels == nullptr) continue;
        std::uint64_t cells = 0;
        for (int n = 0; n < kBlock; ++n)
          if (voxels->extinction[n] != 0) cells |= std::uint64_t{3} << n;
        for (int a = block * kBlock / kCubeSide; cells != 0; ++a, cells >>= kCubeSide) {
          if (!within(a, 0)) continue;
          const std::uint64_t along = cells & ((1 << kCubeSide) - 1);
          for (const int z : {k, k + 1})
            for (const int y : {j, j + 1})
              if (within(y / kCubeSide, 1) && within(z / kCubeSide, 2))
                filled_[index(a, y / kCubeSide, z / kCubeSide)] |=
                    along << kCubeSide * ((y & kLast) + kCubeSide * (z & kLast));
        }
      }
    }
}

void EmptySpaceMap::pass(const Cubes& region, int step) {
  const auto order = [&](int n, std::size_t axis) {
    return step > 0 ? n : region[axis][0] + region[axis][1] - n;
  };
  const int first = region[0][0], count = region[0][1] - first + 1;
  // minimum over the rows already visited, from one cube before the first to one after the last
  std::vector<std::uint8_t> least(static_cast<std::size_t>(count) + 2);
  const int from = std::max(0, first - 1), to = std::min(cubes_[0] - 1, first + count);
  for (int c = region[2][0]; c <= region[2][1]; ++c)
    for (int b = region[1][0]; b <= region[1][1]; ++b) {
      const int y = order(b, 1), z = order(c, 2);
      std::fill(least.begin(), least.end(), kMaxSkip);
      for (int q = 0; q < 4; ++q) {
        const int yy = y + step * (q % 3 - 1), zz = z + step * (q / 3 - 1);
        if (yy < 0 || zz < 0 || yy >= cubes_[1] || zz >= cubes_[2]) continue;
        const std::uint8_t* other = &skip_[index(from, yy, zz)];
        std::uint8_t* lowered = least.data() + (from - first + 1);
        for (int n = 0; n <= to - from; ++n) lowered[n] = std::min(lowered[n], other[n]);
      }
      std::uint8_t* row = &skip_[index(first, y, z)];
      const std::uint8_t* before = least.data();
      for (int n = 0; n < count; ++n) {
        const std::uint8_t beside = std::min(std::min(before[n], before[n + 1]), before[n + 2]);
        row[n] = std::min<std::uint8_t>(row[n], static_cast<std::uint8_t>(beside + 1));
      }
      // then along the row
      const int begin = step > 0 ? 0 : count - 1, ahead = first + begin - step;
      std::uint8_t skip = ahead >= 0 && ahead < cubes_[0] ? row[begin - step] : kMaxSkip;
      for (int n = begin; n >= 0 && n < count; n += step) {
        skip = std::min<std::uint8_t>(row[n], static_cast<std::uint8_t>(skip + 1));
        row[n] = skip;
      }
    }
}

void EmptySpaceMap::update(const BlockRows& rows, const VoxelBox& box) {
  // cubes that the box may fill or empty, and those whose skips depend on them
  Cubes found{}, region{};
  for (std::size_t a = 0; a < 3; ++a) {
    found[a] = {std::max(0, box.first[a] / kCubeSide),
                std::min(cubes_[a] - 1, (box.first[a] + box.size[a]) / kCubeSide)};
    region[a] = {std::max(0, found[a][0] - kMaxSkip), std::min(cubes_[a] - 1, found[a][1] + kMaxSkip)};
  }
  fill(rows, found);
  for (int c = region[2][0]; c <= region[2][1]; ++c)
    for (int b = region[1][0]; b <= region[1][1]; ++b)
      for (int a = region[0][0]; a <= region[0][1]; ++a)
        skip_[index(a, b, c)] = filled_[index(a, b, c)] != 0 ? 0 : kMaxSkip;
  // chessboard distance transform in two passes, including values around the region
  pass(region, 1);
  pass(region, -1);
}

CubesView EmptySpaceMap::view(int x, int y, int z) const {
  const std::int32_t steps[3] = {1, cubes_[0], cubes_[0] * cubes_[1]};
  constexpr int kShift = kCubeShift;
  return {filled_.data(), skip_.data(), {steps[x], steps[y], steps[z]}, {kShift * x, kShift * y, kShift * z}};
}

}  // namespace palpate::internal::volume_picture
