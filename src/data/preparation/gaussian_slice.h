#pragma once

#include <cstdint>
#include <vector>

#include "palpate/volume/gaussian_kernel.h"
#include "palpate/volume/gaussian_rows.h"

namespace palpate::internal {

/// Input of slice smoothing. In is std::uint8_t or float.
template <class In>
struct SmoothingInput {
  const Volume<In>* volume;
  std::vector<std::uint8_t> occupied;  ///< By row (k * ny + j): 1 if any voxel of it is not 0
  std::array<AxisKernel, 3> kernels;   ///< Along i, j, k; none extends beyond the far side of the grid
};

/// Smooths one slice at a time in its own buffers; each worker has an instance.
///
/// The convolution is separable and evaluated in the order k, i, j:
///
///   k   Row j of the slice is the weighted sum of the rows j of the adjacent input slices. As bytes these
///       fit into the cache, and no smoothed slice has to be stored for the next one.
///   i   The resulting row, zero padded on both sides, is convolved with the kernel along i.
///   j   The last 2 r + 1 such rows, stored in a ring, give output row j - r.
///
/// Apart from the output only a few rows are written, which stay in the first-level cache, and slices are
/// independent of each other. Empty rows are skipped: they would add 0, and most of a label map is empty.
///
/// Aligned to prevent false sharing between workers, which cost a third of the speed of two threads.
template <class In>
class alignas(64) SliceSmoother {
 public:
  explicit SliceSmoother(const SmoothingInput<In>& input);
  SliceSmoother(const SliceSmoother&) = delete;
  SliceSmoother& operator=(const SliceSmoother&) = delete;
  SliceSmoother(SliceSmoother&&) = default;

  /// Smooths slice k into `out`, dims[0] * dims[1] voxels; integers are rounded as by sum_rows.
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
  // row with zero padding of the kernel's reach on both sides
  std::vector<float> line_;
  float* line_start_;
  // ring of rows smoothed along k and i, one per weight of the kernel along j; ring_rows_ points to each row,
  // starting with row -reach
  std::size_t ring_stride_;
  std::vector<float> ring_;
  std::vector<const float*> ring_rows_;
  // zero rows used for rows outside the grid and empty rows
  std::vector<In> no_input_;
  std::vector<float> no_ring_;
  std::vector<RowPair<In>> pairs_k_;
  std::vector<RowPair<float>> pairs_i_, pairs_j_;
};

}  // namespace palpate::internal
