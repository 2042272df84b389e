#include "keys.h"

#include <termios.h>
#include <unistd.h>

#include <atomic>

namespace palpate::app {
namespace {

termios terminal_before;
int terminal = -1;
std::atomic<bool> changed{false};

}  // namespace

Keys::Keys(int in) {
  terminal = in;
  // a background process that changes the terminal would be stopped
  if (!::isatty(terminal) || ::tcgetpgrp(terminal) != ::getpgrp()) return;
  if (::tcgetattr(terminal, &terminal_before) != 0) return;
  termios keys = terminal_before;
  keys.c_lflag &= ~static_cast<tcflag_t>(ICANON | ECHO);
  keys.c_cc[VMIN] = 0;
  keys.c_cc[VTIME] = 0;
  changed = ::tcsetattr(terminal, TCSANOW, &keys) == 0;
}

bool Keys::active() const {
  return changed;
}

std::optional<char> Keys::next() {
  char key = 0;
  return changed && ::read(terminal, &key, 1) == 1 ? std::optional(key) : std::nullopt;
}

void Keys::restore() noexcept {
  if (changed.exchange(false)) ::tcsetattr(terminal, TCSANOW, &terminal_before);
}

}  // namespace palpate::app
