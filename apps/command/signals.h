#pragma once

#include <signal.h>

#include <initializer_list>
#include <utility>
#include <vector>

namespace palpate::app {

/// Installs a signal handler during its lifetime, and restores the previous ones afterwards.
class ScopedSignals {
 public:
  ScopedSignals(std::initializer_list<int> signals, void (*handler)(int)) {
    before_.reserve(signals.size());
    for (const int signal : signals) {
      struct sigaction requested {};
      requested.sa_handler = handler;
      requested.sa_flags = SA_RESTART;
      ::sigemptyset(&requested.sa_mask);
      struct sigaction was {};
      if (::sigaction(signal, &requested, &was) == 0) before_.emplace_back(signal, was);
    }
  }
  ~ScopedSignals() {
    for (const auto& [signal, was] : before_) ::sigaction(signal, &was, nullptr);
  }
  ScopedSignals(const ScopedSignals&) = delete;
  ScopedSignals& operator=(const ScopedSignals&) = delete;

 private:
  std::vector<std::pair<int, struct sigaction>> before_;
};

}  // namespace palpate::app
