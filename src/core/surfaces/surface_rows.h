#pragma once

#include <cstddef>
#include <cstdint>

/// Voxel-wise operations of surface preparation, on rows of `length` voxels. Each dispatches to the best SIMD
/// target of the machine; bit-identical for all. Lengths in mm, steps of kSurfaceStep_mm.
namespace palpate::internal {

/// Converts steps to mm, clamped to +-limit_mm.
void steps_to_mm(const std::int16_t* steps, std::size_t length, float limit_mm, float* mm);
/// Converts mm to steps, rounded to nearest.
void mm_to_steps(const float* mm, std::size_t length, std::int16_t* steps);
/// Strided copy: taken[n] = from[n * step].
void take_every(const std::int16_t* from, std::size_t step, std::size_t count, std::int16_t* taken);
/// Whether all values of a row are equal.
bool all_equal(const float* row, std::size_t length);

/// Where mask equals `mine`: distance = sqrt(squared), negative if mine is 1. Other values are unchanged.
void roots_where(const std::uint8_t* mask, std::uint8_t mine, const float* squared, std::size_t length,
                 float* distance);

/// Distance of a smoothed value on the wrong side, relative to the distance times `clamp_fraction`, negated:
/// -1 ... 0. Returns whether any is on the wrong side.
bool wrong_side(const float* distance, const float* smooth, float clamp_fraction, std::size_t length,
                float* wrong);
/// Inputs of hold_position().
struct PositionRows {
  const float *distance, *smooth, *wrong, *preserve;
};
/// Position from the smoothed distance, as documented at PositionFilter.
void hold_position(const PositionRows& rows, float clamp_fraction, std::size_t length,
                   std::int16_t* position);

/// Parameters of weigh_by_position().
struct SurfaceBand {
  float band_mm, slope;
};
/// weight = max(0, 1 - |position| / band), weighted = weight * (broad - slope * position).
void weigh_by_position(const float* position, const float* broad, const SurfaceBand& band, std::size_t length,
                       float* weight, float* weighted);
/// Share of the position that replaces the broad distance, depending on the latter's height at the surface:
/// not at all up to low_mm, by a share of `most` from high_mm on.
struct PositionFraction {
  float low_mm, high_mm, most;
  float slope, limit_mm;  ///< Initial slope and limit of the broad distance over a plane
};
struct NormalRows {
  const float *broad, *position, *surface, *height_sum;
};
void blend_with_position(const NormalRows& rows, const PositionFraction& fraction, std::size_t length,
                         std::int16_t* normal);

/// Greatest sum of squares of (along i, along j, along k) * per_step over the cells between four rows of
/// voxels: (j, k), (j+1, k), (j, k+1), (j+1, k+1). Reads cells + 1 voxels of each.
struct CellRows {
  const std::int16_t* row[4];
  float per_step[3];
};
float steepest_square(const CellRows& rows, std::size_t cells);

}  // namespace palpate::internal
