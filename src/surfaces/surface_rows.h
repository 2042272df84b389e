#pragma once

#include <cstddef>
#include <cstdint>

/// What the preparation of surfaces does voxel by voxel, for rows of `length` voxels. Each picks the best
/// SIMD target of the machine; bits are the same for every one. Lengths in mm, steps of kSurfaceStep_mm.
namespace palpate::internal {

/// at most limit_mm either way
void steps_to_mm(const std::int16_t* steps, std::size_t length, float limit_mm, float* mm);
/// rounded to the nearest
void mm_to_steps(const float* mm, std::size_t length, std::int16_t* steps);
/// taken[n] = from[n * step]
void take_every(const std::int16_t* from, std::size_t step, std::size_t count, std::int16_t* taken);
bool all_equal(const float* row, std::size_t length);

/// Where mask is `mine`: the root of `squared`, negative where mine is 1. Elsewhere nothing.
void roots_where(const std::uint8_t* mask, std::uint8_t mine, const float* squared, std::size_t length,
                 float* distance);

/// How far a smoothed distance lies on the wrong side, of the distance times `held`, negated: -1 ... 0.
/// Returns whether any does.
bool wrong_side(const float* distance, const float* smooth, float held, std::size_t length, float* wrong);
/// The position from the smoothed distance, as docs at PositionFilter say.
struct PositionRows {
  const float *distance, *smooth, *wrong, *keep;
};
void hold_position(const PositionRows& rows, float held, std::size_t length, std::int16_t* position);

/// weight = max(0, 1 - |position| / band), weighted = weight * (broad - slope * position).
struct SurfaceBand {
  float band_mm, slope;
};
void weigh_by_position(const float* position, const float* broad, const SurfaceBand& band, std::size_t length,
                       float* weight, float* weighted);
/// How the broad distance gives way to the position, by the height at which it stands on the surface: not up
/// to low_mm, by `most` from high_mm on.
struct PositionShare {
  float low_mm, high_mm, most;
  float slope, limit_mm;  ///< of the broad distance over a plane: how it begins and where it ends
};
struct NormalRows {
  const float *broad, *position, *surface, *height_sum;
};
void blend_with_position(const NormalRows& rows, const PositionShare& share, std::size_t length,
                         std::int16_t* normal);

/// The greatest sum of squares of (along i, along j, along k) * per_step over the cells between four rows
/// of voxels: (j, k), (j+1, k), (j, k+1), (j+1, k+1). cells + 1 voxels of each are read.
struct CellRows {
  const std::int16_t* row[4];
  float per_step[3];
};
float steepest_square(const CellRows& rows, std::size_t cells);

}  // namespace palpate::internal
