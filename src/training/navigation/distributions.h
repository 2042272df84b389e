#pragma once

namespace palpate {

/// Quantile of the chi-squared distribution, accurate to 1e-9 in probability.
/// @param degrees   degrees of freedom, > 0; need not be an integer
/// @param fraction  probability, in the open interval 0 ... 1
double chi_squared_quantile(double degrees, double fraction);

}  // namespace palpate
