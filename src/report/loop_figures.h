#pragma once

#include <cstdint>
#include <vector>

#include "palpate/recording.h"

/// How the loop kept time in a run on the real clock, from what stands in every tick.
namespace palpate::report {

/// Nearest ranks; NaN of nothing.
struct Spread {
  double p50_s, p99_s, p999_s, max_s;
};
/// Of those values that are finite.
Spread spread_of(std::vector<double> values_s);

/// Ticks a second between the first and the last tick, dropped ones included; NaN for fewer than two.
double measured_rate_hz(const Recording& recording, const std::vector<double>& edges_s);

}  // namespace palpate::report
