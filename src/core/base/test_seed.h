#pragma once

#include <cstdlib>
#include <random>
#include <string>

namespace palpate::test {

/// Seed of a randomised test, which prints it. The same in every run, so that a failure is reproducible,
/// unless PALPATE_TEST_SEED is another number, or "any" for a random one.
inline unsigned test_seed() {
  constexpr unsigned kSeed = 20'261'121;
  const char* asked = std::getenv("PALPATE_TEST_SEED");
  if (asked == nullptr) return kSeed;
  return std::string(asked) == "any" ? std::random_device{}()
                                     : static_cast<unsigned>(std::strtoul(asked, nullptr, 10));
}

}  // namespace palpate::test
