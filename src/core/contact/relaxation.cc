#include "palpate/contact/relaxation.h"

#include <algorithm>
#include <cmath>

#include "palpate/base/hash.h"

namespace palpate {
namespace {

// dents with a smaller elastic force are dropped
constexpr double kMinRemembered_N = 1e-6;

}  // namespace

double Relaxation::total_fraction() const {
  double sum = 0;
  for (const RelaxationTerm& one : term) sum += one.fraction;
  return sum;
}

bool RelaxationTimes::add(const Relaxation& relaxation) {
  for (const RelaxationTerm& one : relaxation.term) {
    if (!(one.fraction > 0)) continue;
    const auto end = time_s.begin() + static_cast<std::ptrdiff_t>(count);
    const auto after = std::lower_bound(time_s.begin(), end, one.time_s);
    if (after != end && *after == one.time_s) continue;
    if (count == kMaxRelaxationTimes) return false;
    std::copy_backward(after, end, end + 1);
    *after = one.time_s;
    ++count;
  }
  return true;
}

void RelaxationFractions::add(const Relaxation& relaxation, const RelaxationTimes& times, double weight) {
  for (const RelaxationTerm& one : relaxation.term)
    for (std::size_t n = 0; n < times.count; ++n)
      if (one.fraction > 0 && times.time_s[n] == one.time_s) of_time[n] += weight * one.fraction;
}

void RelaxationFractions::add(const RelaxationFractions& other, double weight) {
  for (std::size_t n = 0; n < kMaxRelaxationTimes; ++n) of_time[n] += weight * other.of_time[n];
}

bool RelaxationFractions::any() const {
  return std::any_of(of_time.begin(), of_time.end(), [](double part) { return part > 0; });
}

void RelaxationFractions::hash_into(std::uint64_t& hash) const {
  for (std::size_t n = 0; n < kMaxRelaxationTimes; ++n) {
    if (of_time[n] == 0) continue;
    hash_word(hash, n);
    hash_double(hash, of_time[n]);
  }
}

void RelaxationState::hash_into(std::uint64_t& hash) const {
  hash_word(hash, static_cast<std::uint64_t>(presses));
  hash_double(hash, elastic_N);
  for (const double value : lagging_N) hash_double(hash, value);
  for (int axis = 0; axis < 3; ++axis) hash_double(hash, at[axis]);
  fractions.hash_into(hash);
}

Decay decay(double x) {
  // repeated halving of the interval, then doubling formulas
  constexpr double kMaxExponent = 700, kShort = 1.0 / 64;
  x = std::min(x, kMaxExponent);
  double y = x;
  int halved = 0;
  for (; y > kShort; y *= 0.5) ++halved;
  // series of (1 - exp(-y)) / y; the truncation error is below 1e-19
  constexpr double kParts[] = {1.0 / 8, 1.0 / 7, 1.0 / 6, 1.0 / 5, 1.0 / 4, 1.0 / 3, 1.0 / 2};
  double mean = 1;
  for (const double part : kParts) mean = 1 - y * mean * part;
  Decay of{1 - y * mean, mean};
  for (int n = 0; n < halved; ++n) {
    of.mean *= 0.5 * (1 + of.remaining);
    of.remaining *= of.remaining;
  }
  return of;
}

double advance_relaxation(const RelaxationTimes& times, double elastic_N, const RelaxingContact* contact,
                          double dt_s, RelaxationState& state) {
  // fraction of the dent's depth at the tool
  double dent_fraction = 1;
  if (contact != nullptr && elastic_N > 0) {
    if (!state.presses) dent_fraction = 1 - (contact->at - state.at).norm() / contact->dent_radius_mm;
    if (!state.is_active() || !(dent_fraction > 0)) {
      state = {};
      state.fractions = contact->fractions;
      dent_fraction = 1;
    } else if (state.presses) {
      const double blend = std::min(1.0, dt_s / contact->blend_s);
      for (std::size_t n = 0; n < kMaxRelaxationTimes; ++n)
        state.fractions.of_time[n] += blend * (contact->fractions.of_time[n] - state.fractions.of_time[n]);
    }
  }

  // p after the tick is free_response + gain * F_e
  std::array<double, kMaxRelaxationTimes> free_response{}, gain{};
  double lost_N = 0, lost_fraction = 0;
  for (std::size_t n = 0; n < times.count; ++n) {
    const Decay of = decay(dt_s / times.time_s[n]);
    free_response[n] = (of.mean - of.remaining) * state.elastic_N + of.remaining * state.lagging_N[n];
    gain[n] = 1 - of.mean;
    lost_N += state.fractions.of_time[n] * free_response[n];
    lost_fraction += state.fractions.of_time[n] * gain[n];
  }
  // a negative force: the tissue separates from the tool and recovers freely
  const double free_N = lost_N / (1 - lost_fraction);
  state.presses = elastic_N > dent_fraction * free_N;
  state.elastic_N = state.presses ? elastic_N : free_N;
  const double retained = state.presses ? dent_fraction : 1;
  for (std::size_t n = 0; n < times.count; ++n)
    state.lagging_N[n] = retained * free_response[n] + gain[n] * state.elastic_N;
  if (state.presses) {
    if (contact != nullptr) state.at = contact->at;
    return std::max(0.0, elastic_N - lost_fraction * elastic_N - dent_fraction * lost_N);
  }
  if (state.elastic_N < kMinRemembered_N) state = {};
  return 0;
}

}  // namespace palpate
