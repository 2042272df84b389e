#pragma once

#include <cstddef>
#include <span>

#include "palpate/recording/recording.h"

namespace palpate::report {

/// A tick with its index in the recording and its interval on the run's clock.
struct TimedTick {
  const TickRecord& tick;
  std::size_t index;      ///< Index in the recording, from 0
  double begin_s, end_s;  ///< Start of the tick, and start of the next one
};

/// Assigns start and end times to ticks while reading. The last tick gets the duration of the one before it.
/// If the clock does not increase (a damaged file), times are the tick's index divided by the rate.
class TickTimes {
 public:
  explicit TickTimes(const RecordingHead& head);

  /// Calls `observe` with each tick except the last, which follows with the next call or with finish().
  template <class OnTick>
  void take(std::span<const TickRecord> ticks, OnTick&& observe) {
    const TickRecord* last = count_ > 0 ? &last_ : nullptr;
    for (const TickRecord& tick : ticks) {
      const double begin_s = begins(tick);
      if (last != nullptr) observe(TimedTick{*last, count_ - 1, last_begin_s_, begin_s});
      last_step_s_ = last != nullptr ? begin_s - last_begin_s_ : period_s_;
      last_begin_s_ = begin_s;
      last = &tick;
      ++count_;
    }
    if (!ticks.empty()) last_ = ticks.back();
  }
  template <class OnTick>
  void finish(OnTick&& observe) const {
    if (count_ > 0) observe(TimedTick{last_, count_ - 1, last_begin_s_, last_begin_s_ + last_step_s_});
  }

 private:
  double begins(const TickRecord& tick) const {
    return clock_rises_ ? tick.time_s : static_cast<double>(count_) * period_s_;
  }

  bool clock_rises_;
  double period_s_;
  std::size_t count_ = 0;
  TickRecord last_;
  double last_begin_s_ = 0, last_step_s_ = 0;
};

}  // namespace palpate::report
