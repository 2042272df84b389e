#pragma once

#include <chrono>
#include <thread>

namespace palpate::testing {

/// Time limit for an event that a test expects: never reached on a fast machine, while a loaded machine may
/// take a thousand times as long.
inline constexpr std::chrono::minutes kTestPatience{5};

/// True once a condition holds, false after kTestPatience; tested every millisecond.
template <class Condition>
bool soon(Condition&& condition) {
  const auto until = std::chrono::steady_clock::now() + kTestPatience;
  while (!condition()) {
    if (std::chrono::steady_clock::now() > until) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return true;
}

}  // namespace palpate::testing
