#pragma once

#include <optional>

namespace palpate::app {

/// Unbuffered key input without echo from the terminal that a run reads from, during its lifetime; inactive
/// if the descriptor is not a terminal. One instance per process at a time.
class Keys {
 public:
  explicit Keys(int in);
  ~Keys() { restore(); }
  Keys(const Keys&) = delete;
  Keys& operator=(const Keys&) = delete;

  /// Whether keys are read from a terminal.
  bool active() const;
  /// Next key pressed, if any; does not block.
  std::optional<char> next();
  /// Restores the terminal's settings. Async-signal-safe.
  static void restore() noexcept;
};

}  // namespace palpate::app
