#pragma once

#include <cstdint>
#include <vector>

#include "palpate/volume/gaussian_kernel.h"
#include "palpate/volume/gaussian_rows.h"

namespace palpate::internal {

/// What smoothing a slice reads. In is std::uint8_t or float.
template <class In>
struct SmoothingInput {
  const Volume<In>* volume;
  std::vector<std::uint8_t> occupied;  ///< by row (k * ny + j): 1 when any voxel of it is not 0
  std::array<AxisKernel, 3> kernels;   ///< along i, j, k; none reaches beyond the grid's far side
};

/// Smooths one slice after the other, in memory of its own: a worker has one.
///
/// The convolution is separable and taken in the order k, i, j:
///
///   k   row j of the slice is the sum of the rows j of the input slices around it. In bytes these are
///       small enough to stay in the cache, and no smoothed slice is kept for the next one.
///   i   that row, between zeros, summed with itself shifted.
///   j   the last 2 r + 1 such rows, kept in a ring, give output row j - r.
///
/// So all that is written besides the output is a few rows, which stay in the first-level cache, and no
/// slice depends on another. Rows that hold nothing are left out: they would add 0, and most of a label
/// map is empty.
///
/// Aligned, so that the workers' bookkeeping does not share cache lines: that cost a third of the speed
/// of two threads.
template <class In>
class alignas(64) SliceSmoother {
 public:
  explicit SliceSmoother(const SmoothingInput<In>& input);
  SliceSmoother(const SliceSmoother&) = delete;
  SliceSmoother& operator=(const SliceSmoother&) = delete;
  SliceSmoother(SliceSmoother&&) = default;

  /// Slice k into out, dims[0] * dims[1] voxels; integers as sum_rows stores them.
  template <class Out>
  void smooth(int k, Out* out);

 private:
  void fill_ring_row(int j, int k);
  template <class Out>
  void write_row(int j, Out* out);

  bool occupied(int j, int k) const;
  const In* input_row(int j, int k) const;

  const SmoothingInput<In>* input_;
  int nx_, ny_, nz_;
  // a row with the reach of the kernel in zeros on both sides
  std::vector<float> line_;
  float* line_start_;
  // rows smoothed along k and i, as many as the kernel along j spans; ring_rows_ tells where
  // each row stands, beginning with row -reach
  std::size_t ring_stride_;
  std::vector<float> ring_;
  std::vector<const float*> ring_rows_;
  // stand for rows outside the grid and rows that hold nothing
  std::vector<In> no_input_;
  std::vector<float> no_ring_;
  std::vector<RowPair<In>> pairs_k_;
  std::vector<RowPair<float>> pairs_i_, pairs_j_;
};

}  // namespace palpate::internal
