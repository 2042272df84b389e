#pragma once

#include "palpate/volume/gaussian_rows.h"

namespace palpate::internal {

/// The one operation of a distance transform by rows, and of a widest-of-neighbours filter.
///
///     least[x] = min(centre[x], before_1[x] + weight_1, after_1[x] + weight_1, ...)
///
/// Picks the best SIMD target of the machine; bits are the same for every one. centre_weight is not used.
void least_of_rows(const WeightedRows<float>& rows, std::size_t length, float* least);

}  // namespace palpate::internal
