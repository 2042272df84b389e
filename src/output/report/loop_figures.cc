#include "report/loop_figures.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

namespace palpate::report {
namespace {

// sign, exponent and 12 bits of the fraction are kept
constexpr int kDroppedBits = 52 - 12;

}  // namespace

void SpreadMeter::add(double value_s) {
  if (!std::isfinite(value_s)) return;
  Bin& bin = bins_[std::bit_cast<std::uint64_t>(value_s) >> kDroppedBits];
  bin.largest_s = bin.count == 0 ? value_s : std::max(bin.largest_s, value_s);
  ++bin.count;
  ++count_;
}

Spread SpreadMeter::spread() const {
  std::vector<Bin> sorted;
  for (const auto& [key, bin] : bins_) sorted.push_back(bin);
  std::ranges::sort(sorted, {}, &Bin::largest_s);
  const auto at = [&](double part) {
    // nearest rank: the smallest value that is not exceeded by at least this fraction
    const double rank = std::max(std::ceil(part * static_cast<double>(count_)), 1.0);
    std::uint64_t count = 0;
    for (const Bin& bin : sorted) {
      count += bin.count;
      if (static_cast<double>(count) >= rank) return bin.largest_s;
    }
    return std::numeric_limits<double>::quiet_NaN();
  };
  return {at(0.5), at(0.99), at(0.999), at(1)};
}

void TickRateMeter::observe(const TimedTick& now) {
  if (ticks_++ == 0) {
    first_ = now.tick.tick;
    first_s_ = now.begin_s;
  }
  last_ = now.tick.tick;
  last_s_ = now.begin_s;
}

double TickRateMeter::rate_hz() const {
  if (ticks_ < 2) return std::numeric_limits<double>::quiet_NaN();
  return (static_cast<double>(last_) - static_cast<double>(first_)) / (last_s_ - first_s_);
}

}  // namespace palpate::report
