#pragma once

#include <cstddef>
#include <cstdint>

namespace palpate::internal {

/// Two rows at the same distance from the row that is computed, and their common weight.
template <class T>
struct RowPair {
  const T* before;
  const T* after;
  float weight;
};

/// Rows and weights of one weighted sum:
/// sum[x] = centre_weight * centre[x] + weight_1 * (before_1[x] + after_1[x]) + weight_2 * ...
template <class T>
struct WeightedRows {
  const T* centre;
  float centre_weight;
  const RowPair<T>* pairs;
  std::size_t pair_count;
};

/// Weighted sum of rows of `length` voxels, the only arithmetic of the smoothing filter. Dispatches to the
/// best SIMD target of the machine. Results are bit-identical for every target and vector length, because
/// each voxel is computed by the multiplications and additions above in that order, never fused.
void sum_rows(const WeightedRows<std::uint8_t>& rows, std::size_t length, float* out);
void sum_rows(const WeightedRows<float>& rows, std::size_t length, float* out);
/// Weighted sum rounded to nearest; it must lie within 0 ... 255.
void sum_rows(const WeightedRows<float>& rows, std::size_t length, std::uint8_t* out);
/// 257 times the weighted sum, rounded to nearest: 0 ... 255 becomes 0 ... 65535.
void sum_rows(const WeightedRows<float>& rows, std::size_t length, std::uint16_t* out);

}  // namespace palpate::internal
