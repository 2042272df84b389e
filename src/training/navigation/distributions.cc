#include "navigation/distributions.h"

#include <cmath>

#include "palpate/base/check.h"

namespace palpate {
namespace {

// Regularised lower incomplete gamma function P(a, x) by its series (Abramowitz and Stegun 6.5.29), whose
// terms are all positive.
double gamma_fraction(double a, double x) {
  if (x <= 0) return 0;
  double term = 1 / a, sum = term;
  for (double n = a + 1; term > 1e-17 * sum; ++n) sum += term *= x / n;
  return sum * std::exp(a * std::log(x) - x - std::lgamma(a));
}

}  // namespace

double chi_squared_quantile(double degrees, double fraction) {
  PALPATE_CHECK(degrees > 0 && fraction > 0 && fraction < 1);
  double low = 0, high = degrees + 1;
  while (gamma_fraction(degrees / 2, high / 2) < fraction) high *= 2;
  for (int n = 0; n < 200 && high - low > 1e-14 * high; ++n) {
    const double midpoint = (low + high) / 2;
    (gamma_fraction(degrees / 2, midpoint / 2) < fraction ? low : high) = midpoint;
  }
  return (low + high) / 2;
}

}  // namespace palpate
