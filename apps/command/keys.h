#pragma once

#include <optional>

namespace palpate::app {

/// Single keys from the terminal that a run reads from, as they are pressed and without being shown, while
/// this lives. None when that is no terminal. One at a time in a process.
class Keys {
 public:
  explicit Keys(int in);
  ~Keys() { restore(); }
  Keys(const Keys&) = delete;
  Keys& operator=(const Keys&) = delete;

  /// There is a terminal whose keys are read.
  bool active() const;
  /// The next key that has been pressed; never waits.
  std::optional<char> next();
  /// The terminal as it was. Signal handlers may call it.
  static void restore() noexcept;
};

}  // namespace palpate::app
