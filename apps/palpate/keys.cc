#include "keys.h"

#include <termios.h>
#include <unistd.h>

#include <atomic>

namespace palpate::app {
namespace {

termios terminal_before;
std::atomic<bool> changed{false};

}  // namespace

Keys::Keys() {
  // a program in the background must not touch the terminal: it would be stopped
  if (!::isatty(STDIN_FILENO) || ::tcgetpgrp(STDIN_FILENO) != ::getpgrp()) return;
  if (::tcgetattr(STDIN_FILENO, &terminal_before) != 0) return;
  termios keys = terminal_before;
  keys.c_lflag &= ~static_cast<tcflag_t>(ICANON | ECHO);
  keys.c_cc[VMIN] = 0;
  keys.c_cc[VTIME] = 0;
  changed = ::tcsetattr(STDIN_FILENO, TCSANOW, &keys) == 0;
}

bool Keys::active() const {
  return changed;
}

std::optional<char> Keys::next() {
  char key = 0;
  return changed && ::read(STDIN_FILENO, &key, 1) == 1 ? std::optional(key) : std::nullopt;
}

void Keys::restore() noexcept {
  if (changed.exchange(false)) ::tcsetattr(STDIN_FILENO, TCSANOW, &terminal_before);
}

}  // namespace palpate::app
