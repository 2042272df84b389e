#pragma once

#include <cstdint>
#include <random>

#include "palpate/base/hash.h"

namespace palpate {

/// Natural variation determined by a seed, uniform between limits, so that a few phantoms cover the whole
/// range. Seed 0: no variation.
class PhantomVariation {
 public:
  explicit PhantomVariation(std::uint64_t seed) : varied_(seed != 0) {
    std::uint64_t state = kHashSeed;
    hash_word(state, seed);
    random_.seed(hash_finish(state));
  }
  /// Random number from `smallest` to `largest`; `mean` for seed 0.
  double within(double smallest, double largest, double mean) {
    const double fraction = static_cast<double>(random_() >> 11) * 0x1.0p-53;
    return varied_ ? smallest + (largest - smallest) * fraction : mean;
  }
  double factor(double largest) { return within(1 - largest, 1 + largest, 1); }
  double offset(double largest) { return within(-largest, largest, 0); }

 private:
  bool varied_;
  std::mt19937_64 random_;
};

}  // namespace palpate
