#pragma once

#include <chrono>
#include <thread>

namespace palpate::testing {

/// How long a test waits for what must come: a fast machine never does, and one that works on much else may
/// take a thousand times as long.
inline constexpr std::chrono::minutes kTestPatience{5};

/// Whether a condition comes true while anybody would wait for it; asked every millisecond.
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
