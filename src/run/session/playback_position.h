#pragma once

#include <algorithm>
#include <chrono>

#include "palpate/server/viewer_requests.h"

namespace palpate {

/// Playback position in a recording. Not thread-safe.
class PlaybackPosition {
 public:
  PlaybackPosition(double begin_s, double end_s) : begin_s_(begin_s), end_s_(end_s), from_s_(begin_s) {}

  double now_s() {
    if (!playing_) return from_s_;
    const double passed_s = std::chrono::duration<double>(Clock::now() - since_).count();
    const double now_s = from_s_ + speed_ * passed_s;
    if (now_s > begin_s_ && now_s < end_s_) return now_s;
    // playback stops at either end
    if (speed_ > 0 ? now_s >= end_s_ : now_s <= begin_s_) set_position(speed_ > 0 ? end_s_ : begin_s_, false);
    return std::clamp(now_s, begin_s_, end_s_);
  }
  bool playing() {
    (void)now_s();
    return playing_;
  }
  double speed() const { return speed_; }
  /// Position at which playback began, or at which it is paused.
  double from_s() const { return from_s_; }

  void follow(const PlayRequest& request) {
    double at_s = std::clamp(request.at_s.value_or(now_s()), begin_s_, end_s_);
    speed_ = request.speed.value_or(speed_);
    const bool plays = request.playing.value_or(playing_);
    const double end_s = speed_ > 0 ? end_s_ : begin_s_;
    if (request.playing == true && !request.at_s && at_s == end_s) at_s = speed_ > 0 ? begin_s_ : end_s_;
    set_position(at_s, plays);
  }
  void stop() { set_position(now_s(), false); }

 private:
  using Clock = std::chrono::steady_clock;

  void set_position(double at_s, bool plays) {
    from_s_ = at_s;
    since_ = Clock::now();
    playing_ = plays;
  }

  const double begin_s_, end_s_;
  double from_s_, speed_ = 1;
  Clock::time_point since_ = Clock::now();
  bool playing_ = false;
};

}  // namespace palpate
