#pragma once

#include <optional>

namespace palpate::app {

/// Single keys from the terminal, as they are pressed and without being shown, while this lives. Where
/// standard input is no terminal, there are none.
class Keys {
 public:
  Keys();
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
