#pragma once

namespace palpate {

/// The value below which a share of a chi-squared distribution lies, within 1e-9 of the share.
/// @param degrees  > 0, of freedom; a whole number or not
/// @param share    0 ... 1, both excluded
double chi_squared_quantile(double degrees, double share);

}  // namespace palpate
