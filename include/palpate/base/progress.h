#pragma once

#include <atomic>
#include <functional>
#include <string>
#include <string_view>

#include "palpate/base/result.h"

namespace palpate {

/// Progress reports and cancellation of long work. Passed by const reference to everything that can take more
/// than a moment; default-constructed it reports nothing and never cancels.
class Progress {
 public:
  /// Callback(stage, fraction): fraction in [0,1]; called from any thread, but never concurrently by one
  /// piece of work.
  using Show = std::function<void(std::string_view stage, double fraction)>;

  Progress() = default;
  /// @param stop          set to true (e.g. by a signal handler) to cancel; may be nullptr
  /// @param acknowledged  set to true once the work has noticed `stop`; may be nullptr
  Progress(Show show, const std::atomic<bool>* stop, std::atomic<bool>* acknowledged = nullptr)
      : show_(std::move(show)), stop_(stop), acknowledged_(acknowledged) {}

  void report(std::string_view stage, double fraction) const {
    if (show_) show_(stage, fraction);
  }
  bool stopped() const {
    if (stop_ == nullptr || !stop_->load(std::memory_order_relaxed)) return false;
    if (acknowledged_ != nullptr) acknowledged_->store(true, std::memory_order_relaxed);
    return true;
  }

  /// Error that cancelled work returns.
  static Error interrupted() { return {ErrorKind::kInterrupted, "interrupted", "", ""}; }

 private:
  Show show_;
  const std::atomic<bool>* stop_ = nullptr;
  std::atomic<bool>* acknowledged_ = nullptr;
};

/// Receiver of warnings for the user (never called from the servo tick). Default-constructed: warnings are
/// dropped.
using Warn = std::function<void(const std::string& message)>;

}  // namespace palpate
