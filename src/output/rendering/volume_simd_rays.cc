// Single rays through the lit blocks, for pixels at edges of the picture that the lines do not resolve.

#include <cmath>
#include <cstring>

#include "rendering/volume_simd.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "rendering/volume_simd_rays.cc"
#include <hwy/foreach_target.h>
// after foreach_target.h
#include <hwy/highway.h>

#include "rendering/volume_simd-inl.h"

HWY_BEFORE_NAMESPACE();
namespace palpate::internal::volume_picture::HWY_NAMESPACE {

/// Vector of four numbers on every target, including the scalar one, so Highway's types are not used.
using V4 = float __attribute__((vector_size(16)));

/// Loads four 16-bit integers.
HWY_INLINE V4 load_four(const std::uint32_t* two_pairs) {
  using I4 = std::int32_t __attribute__((vector_size(16)));
  std::uint64_t bits;
  std::memcpy(&bits, two_pairs, sizeof bits);
  using U4 = std::uint16_t __attribute__((vector_size(8)));
  U4 whole;
  std::memcpy(&whole, &bits, sizeof whole);
  return __builtin_convertvector(__builtin_convertvector(whole, I4), V4);
}

HWY_INLINE V4 all_four(float value) {
  return V4{value, value, value, value};
}

/// Scalar version of the same function.
HWY_INLINE float exp_of_minus(float t) {
  const float part = t * (1.0f / 16), y = part < 1 ? part : 1.0f;
  float p = 1.0f / 24;
  p = 1.0f / 6 - y * p;
  p = 0.5f - y * p;
  p = 1.0f - y * p;
  p = 1.0f - y * p;
  p = p * p;
  p = p * p;
  p = p * p;
  return p * p;
}

/// Position on a ray: the voxels before it.
struct RayPosition {
  int x, y;
  float x_part, y_part;  ///< Fractions beyond them
};

HWY_INLINE RayPosition ray_position(const RowsView& rows, float x, float y) {
  RayPosition position;
  // inside the grid, coordinates are above -1
  position.x = static_cast<int>(x + 1) - 1;
  // x + 1 may be rounded up to the border
  if (position.x >= rows.count[0]) position.x = rows.count[0] - 1;
  position.x_part = x - static_cast<float>(position.x);
  position.y = static_cast<int>(y + 1) - 1;
  position.y_part = y - static_cast<float>(position.y);
  return position;
}

/// The eight voxels around a position on a ray: two in each of four rows, in one block or two adjacent ones.
struct InterpolationCell {
  float plane;
  int in_block;  ///< Voxel before the position; if it is a block's last one, the other is in the next block
  float part;    ///< Fraction beyond it
  std::uint32_t offsets[4][2];
  float weight[4];
};

/// Also prefetches the blocks, since those around a single ray are rarely cached.
/// @returns whether any is stored
HWY_INLINE bool find_around(const RowsView& rows, const RayPosition& ray_position, const SamplePlane& plane,
                            const LitBlockCache& lit, InterpolationCell& around) {
  const int block = block_of_voxel(ray_position.x);
  around.in_block = ray_position.x - block * kBlock;
  around.part = ray_position.x_part;
  std::uint32_t any = 0;
  for (int n = 0; n < 4; ++n) {
    const int far = n & 1, deep = n >> 1, yy = ray_position.y + far, zz = plane.slice + deep;
    const bool is_in = yy >= 0 && yy < rows.count[1] && zz >= 0 && zz < rows.count[2];
    const std::ptrdiff_t row = is_in ? yy * rows.row[1] + zz * rows.row[2] : 0;
    for (int m = 0; m < 2; ++m) {
      const int b = block + m;
      const bool is_there = is_in && b >= 0 && b < rows.blocks && (m == 0 || around.in_block == kBlock - 1);
      const std::uint32_t found =
          is_there ? slot_of(rows.mask + row * rows.words, rows.first + row * rows.groups, b) : 0;
      prefetch_block(rows, found, lit);
      around.offsets[n][m] = found;
      any |= found;
    }
    around.weight[n] = (far != 0 ? ray_position.y_part : 1 - ray_position.y_part) *
                       (deep != 0 ? plane.beyond : 1 - plane.beyond);
  }
  return any != 0;
}

/// Mixes their red, green, blue and extinction.
HWY_INLINE V4 mix_voxels(const RowsView& rows, const InterpolationCell& around, LitBlockCache& lit) {
  // two voxels each: red and green; blue and extinction
  V4 first{}, second{};
  for (int n = 0; n < 4; ++n) {
    const auto& offsets = around.offsets[n];
    if ((offsets[0] | offsets[1]) == 0) continue;
    const V4 weight = all_four(around.weight[n]);
    const LitBlock& low = lit_block(rows, offsets[0], lit);
    if (around.in_block < kBlock - 1) {
      first += load_four(low.pair[0] + around.in_block) * weight;
      second += load_four(low.pair[1] + around.in_block) * weight;
      continue;
    }
    std::uint32_t pairs[2][2];
    for (int m = 0; m < 2; ++m) pairs[m][0] = low.pair[m][kBlock - 1];
    const LitBlock& high = lit_block(rows, offsets[1], lit);
    for (int m = 0; m < 2; ++m) pairs[m][1] = high.pair[m][0];
    first += load_four(pairs[0]) * weight;
    second += load_four(pairs[1]) * weight;
  }
  const float near = 1 - around.part, far = around.part;
  const V4 weight{near, near, far, far};
  first *= weight;
  second *= weight;
  return __builtin_shufflevector(first, second, 0, 1, 4, 5) +
         __builtin_shufflevector(first, second, 2, 3, 6, 7);
}

/// Exit of a ray from cubes along x, y and z; the fourth component repeats the third.
struct Leaving {
  V4 planes_per;       ///< Planes per voxel
  V4 towards, beyond;  ///< The exit border is `towards` times `skip` plus `beyond` cubes away
};

HWY_INLINE Leaving leaving_of(const float* pace) {
  Leaving leaving;
  for (int n = 0; n < 4; ++n) {
    const float by = pace[n < 3 ? n : 2];
    // with almost no motion along an axis the ray never exits along it
    leaving.planes_per[n] = std::abs(by) < 1e-6f ? 1e6f : 1 / by;
    leaving.towards[n] = leaving.planes_per[n] > 0 ? 1.0f : -1.0f;
    leaving.beyond[n] = leaving.planes_per[n] > 0 ? 0.0f : 1.0f;
  }
  return leaving;
}

/// Next plane on which the ray has left the empty cubes around a cell.
/// @param ray_position  voxels
HWY_INLINE int skip_empty_cubes(const CubesView& cubes, std::ptrdiff_t index, const int* cell,
                                const V4& ray_position, const Leaving& leaving, int plane) {
  const V4 cube{static_cast<float>(cell[0] >> kCubeShift), static_cast<float>(cell[1] >> kCubeShift),
                static_cast<float>(cell[2] >> kCubeShift), static_cast<float>(cell[2] >> kCubeShift)};
  const V4 border =
      (cube + leaving.towards * all_four(cubes.skip[index]) + leaving.beyond) * all_four(kCubeSide);
  const V4 planes = (border - (ray_position + all_four(1))) * leaving.planes_per;
  const float along = planes[0] < planes[1] ? planes[0] : planes[1],
              away = along < planes[2] ? along : planes[2];
  const int by = static_cast<int>(std::ceil(away - 1e-3f));
  return plane + (by > 1 ? by : 1);
}

/// Range of planes on which a ray is inside the grid or less than a voxel outside, along one axis.
HWY_INLINE void bound_planes(float start, float per_plane, int count, float& begin, float& end) {
  // excludes a margin at the border, where nothing is visible, larger than the accumulated rounding error
  const auto border = static_cast<float>(count);
  const float off = 1e-4f + 4e-7f * (std::abs(start) + border), low = off - 1, high = border - off;
  if (std::abs(per_plane) < 1e-9f) {
    if (start < low || start > high) end = begin;
    return;
  }
  const float a = (low - start) / per_plane, b = (high - start) / per_plane;
  const float enter = std::ceil(a < b ? a : b), leave = std::floor(a < b ? b : a) + 1;
  if (enter > begin) begin = enter;
  if (leave < end) end = leave;
}

HWY_INLINE void trace_ray(const RowsView& rows, const CubesView& cubes, const SamplePlane* planes,
                          int plane_count, float z_per_plane, bool wants_hits, LitBlockCache& lit,
                          TracedRay& ray) {
  V4 sum{};
  float clear = 1;
  ray.half_plane = -1;
  float begin = std::floor(ray.first) - 1, end = std::floor(ray.last) + 2;
  if (ray.first_filled > begin) begin = ray.first_filled;
  if (begin < 0) begin = 0;
  if (static_cast<float>(plane_count) < end) end = static_cast<float>(plane_count);
  bound_planes(ray.x, ray.x_per_plane, rows.count[0], begin, end);
  bound_planes(ray.y, ray.y_per_plane, rows.count[1], begin, end);
  const float pace[3] = {ray.x_per_plane, ray.y_per_plane, z_per_plane};
  const Leaving leaving = leaving_of(pace);
  const int stop = end > begin ? static_cast<int>(end) : 0;
  int p = end > begin ? static_cast<int>(begin) : 0;
  const auto find_next = [&](InterpolationCell& around) HWY_ATTR {
    while (p < stop) {
      const auto plane = static_cast<float>(p);
      const float x = ray.x + ray.x_per_plane * plane, y = ray.y + ray.y_per_plane * plane;
      const RayPosition at = ray_position(rows, x, y);
      const int cell[3] = {at.x + 1, at.y + 1, planes[p].slice + 1};
      std::ptrdiff_t index = 0;
      int bit = 0;
      for (int a = 0; a < 3; ++a) {
        index += (cell[a] >> kCubeShift) * std::ptrdiff_t{cubes.step[a]};
        bit += (cell[a] & (kCubeSide - 1)) << cubes.shift[a];
      }
      const std::uint64_t filled = cubes.filled[index];
      if ((filled >> bit & 1) == 0) {
        const float z = static_cast<float>(planes[p].slice) + planes[p].beyond;
        p = filled != 0 ? p + 1 : skip_empty_cubes(cubes, index, cell, V4{x, y, z, z}, leaving, p);
        continue;
      }
      around.plane = plane;
      if (find_around(rows, at, planes[p++], lit, around)) return true;
    }
    return false;
  };
  // software pipelining: find the next position and prefetch its voxels while the current ones are being
  // loaded
  InterpolationCell found[2];
  bool is_found = find_next(found[0]);
  for (int n = 0; is_found && clear >= kDone; n = 1 - n) {
    is_found = find_next(found[1 - n]);
    const V4 mixed = mix_voxels(rows, found[n], lit);
    // voxels with zero weight contribute nothing
    if (mixed[3] == 0) continue;
    const float plane = found[n].plane, q = plane + 0.5f;
    float begun = q - ray.first, left = ray.last + 1 - q;
    begun = begun < 0 ? 0 : begun > 1 ? 1 : begun;
    left = left < 0 ? 0 : left > 1 ? 1 : left;
    const float extinction = mixed[3] * (1 / kDepthSteps), depth = extinction * (ray.step * (begun * left)),
                after = clear * exp_of_minus(depth);
    const float fraction = (clear - after) / (extinction > kTiny ? extinction : kTiny) * (1 / kDepthSteps);
    sum += mixed * all_four(fraction);
    if (wants_hits && clear > 0.5f && after <= 0.5f)
      ray.half_plane = plane - 0.5f + std::log(2 * clear) / depth;
    clear = after;
  }
  for (int c = 0; c < 3; ++c) ray.channel[c] = sum[c];
  ray.transmittance = clear;
}

void trace_rays(const RowsView& rows, const CubesView& cubes, const SamplePlane* planes, int plane_count,
                float z_per_plane, bool wants_hits, int count, TracedRay* rays, LitBlockCache& lit) {
  for (int n = 0; n < count; ++n)
    trace_ray(rows, cubes, planes, plane_count, z_per_plane, wants_hits, lit, rays[n]);
}

}  // namespace palpate::internal::volume_picture::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace palpate::internal::volume_picture {

HWY_EXPORT(trace_rays);

void trace_rays(const RowsView& rows, const CubesView& cubes, const SamplePlane* planes, int plane_count,
                float z_per_plane, bool wants_hits, int count, TracedRay* rays, LitBlockCache& lit) {
  HWY_DYNAMIC_DISPATCH(trace_rays)
  (rows, cubes, planes, plane_count, z_per_plane, wants_hits, count, rays, lit);
}

}  // namespace palpate::internal::volume_picture
#endif  // HWY_ONCE
