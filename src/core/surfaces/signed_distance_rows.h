#pragma once

#include "palpate/volume/gaussian_rows.h"

namespace palpate::internal {

/// Elementary operation of a distance transform by rows, and of a minimum filter:
///
///     smallest[x] = min(centre[x], before_1[x] + weight_1, after_1[x] + weight_1, ...)
///
/// Dispatches to the best SIMD target of the machine; bit-identical for all. centre_weight is ignored.
void min_of_rows(const WeightedRows<float>& rows, std::size_t length, float* smallest);

}  // namespace palpate::internal
