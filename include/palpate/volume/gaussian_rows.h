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

/// The rows of one weighted sum, a kernel's reach:
/// sum[x] = centre_weight * centre[x] + weight_1 * (before_1[x] + after_1[x]) + weight_2 * ...
template <class T>
struct WeightedRows {
  const T* centre;
  float centre_weight;
  const RowPair<T>* pairs;
  std::size_t pair_count;
};

/// The weighted sum of rows of `length` voxels, the one operation that the whole smoothing consists of.
/// Picks the best SIMD target of the machine. Bits are the same for every target and vector length,
/// because each voxel sees the multiplications and additions above in that order, never fused.
void sum_rows(const WeightedRows<std::uint8_t>& rows, std::size_t length, float* out);
void sum_rows(const WeightedRows<float>& rows, std::size_t length, float* out);
/// Rounded to nearest; the sum lies within 0 ... 255.
void sum_rows(const WeightedRows<float>& rows, std::size_t length, std::uint8_t* out);
/// 257 times the sum, rounded to nearest: 0 ... 255 becomes 0 ... 65535.
void sum_rows(const WeightedRows<float>& rows, std::size_t length, std::uint16_t* out);

}  // namespace palpate::internal
