#pragma once

#include <cstdlib>
#include <random>
#include <string>

namespace palpate::test {

/// Seed of a randomised test, which prints it. The same in every run, so that a failure is reproducible,
/// unless PALPATE_TEST_SEED is another number, or "any" for a random one.
inline unsigned test_seed() {
  constexpr unsigned kSeed = 20'261'121;
  const char* value = std::getenv("PALPATE_TEST_SEED");
  if (value == nullptr) return kSeed;
  return std::string(value) == "any" ? std::random_device{}()
                                     : static_cast<unsigned>(std::strtoul(value, nullptr, 10));
}

}  // namespace palpate::test
