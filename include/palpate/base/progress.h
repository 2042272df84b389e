#pragma once

#include <atomic>
#include <functional>
#include <string>
#include <string_view>

#include "palpate/base/result.h"

namespace palpate {

/// How long work tells where it stands and learns that it should stop. Passed by const reference
/// through everything that can take more than a moment; default-constructed it is silent and endless.
class Progress {
 public:
  /// show(stage, fraction): fraction in [0,1]; may be called from any thread, not concurrently
  /// by one piece of work. stop: set to true (from a signal handler, say) to interrupt. heard: becomes true
  /// when the work has seen that; may be nullptr.
  using Show = std::function<void(std::string_view stage, double fraction)>;

  Progress() = default;
  Progress(Show show, const std::atomic<bool>* stop, std::atomic<bool>* heard = nullptr)
      : show_(std::move(show)), stop_(stop), heard_(heard) {}

  void report(std::string_view stage, double fraction) const {
    if (show_) show_(stage, fraction);
  }
  bool stopped() const {
    if (stop_ == nullptr || !stop_->load(std::memory_order_relaxed)) return false;
    if (heard_ != nullptr) heard_->store(true, std::memory_order_relaxed);
    return true;
  }

  /// The Error that interrupted work returns.
  static Error interrupted() { return {ErrorKind::kInterrupted, "interrupted", "", ""}; }

 private:
  Show show_;
  const std::atomic<bool>* stop_ = nullptr;
  std::atomic<bool>* heard_ = nullptr;
};

/// Where warnings for a person go (never from the servo tick). Default-constructed: nowhere.
using Warn = std::function<void(const std::string& message)>;

}  // namespace palpate
