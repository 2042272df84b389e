#pragma once

#include <cmath>
#include <cstdint>

namespace palpate::haply {

/// Decides whether a sender's states may come from a queue, by the number of unsolicited states. They may
/// after a stall, and when more arrive than the known pace explains, until a time window contains no more
/// than that. A pace that is sustained becomes the known pace.
class SenderPace {
 public:
  explicit SenderPace(std::int64_t now_ns = 0) : observed_ns_(now_ns), started_ns_(now_ns) {}

  /// @param count  number of unsolicited states since the last call
  void observe(int count, std::int64_t now_ns) {
    const bool stalled = now_ns - observed_ns_ > kStall_ns;
    observed_ns_ = now_ns;
    if (stalled) return assume_queued(now_ns);
    count_ += count;
    const double window_s = static_cast<double>(now_ns - started_ns_) * 1e-9;
    const bool explained = count_ <= kSurplus + kAbove * pace_hz_ * window_s;
    if (!queued_ && !explained) return assume_queued(now_ns);
    if (window_s < kWindow_s) return;
    const double hz = count_ / window_s;
    steady_windows_ = std::abs(hz - before_hz_) * window_s <= kSurplus + kSteady * before_hz_ * window_s
                          ? steady_windows_ + 1
                          : 0;
    if (!queued_)
      pace_hz_ += kFollowed * (hz - pace_hz_);
    else if (steady_windows_ >= kSteadyWindows)
      pace_hz_ = hz;
    if (explained || steady_windows_ >= kSteadyWindows) queued_ = false;
    before_hz_ = hz;
    started_ns_ = now_ns;
    count_ = 0;
  }
  /// States may be queued from now on.
  void assume_queued(std::int64_t now_ns) {
    if (!queued_) steady_windows_ = 0;
    queued_ = true;
    observed_ns_ = started_ns_ = now_ns;
    count_ = 0;
  }
  bool may_be_queued() const { return queued_; }

 private:
  static constexpr std::int64_t kStall_ns = 10'000'000;
  static constexpr double kWindow_s = 0.02;
  // tolerance in states per window, and factor relative to the known pace; maximum difference of successive
  // windows of a steady pace
  static constexpr double kSurplus = 4, kAbove = 1.5, kSteady = 0.25;
  // low-pass coefficient of the known pace per window; number of steady windows after which a new pace is
  // adopted at once
  static constexpr double kFollowed = 0.1;
  static constexpr int kSteadyWindows = 25;

  bool queued_ = false;
  std::int64_t observed_ns_, started_ns_;
  int count_ = 0, steady_windows_ = 0;
  double pace_hz_ = 0, before_hz_ = 0;
};

}  // namespace palpate::haply
