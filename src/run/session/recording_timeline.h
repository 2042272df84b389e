#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "palpate/recording/recording.h"
#include "palpate/recording/recording_source.h"
#include "palpate/server/viewer_host.h"

namespace palpate {

/// Time line of a recording, accumulated tick by tick; memory is bounded independently of the number of
/// ticks.
class RecordingTimeline {
 public:
  /// Maximum gap within a contact; shorter gaps would not be visible on the time line.
  static constexpr double kMaxContactGap_s = 0.05;
  static constexpr std::size_t kMaxContacts = 2000, kMaxEvents = 2000, kForceIntervals = 1000;

  /// @param head  header of the recording whose ticks follow
  explicit RecordingTimeline(const RecordingHead& head);
  void observe(const RecordingPart& part);
  /// Returns the time line, after the last part.
  ViewedRecording take();

 private:
  void observe(const TickRecord& tick);
  void observe(const RecordingEvent& event);
  void observe(int device, const DeviceTick& tick, double time_s);
  void end(ViewedRecording::Contact& contact);
  void drop_short_contacts();

  const double rate_hz_;
  const int devices_;
  ViewedRecording line_;
  ViewedRecording::Contact open_[kMaxDevices];  // current contact per device; label 0: none yet
  std::uint64_t tick_count_ = 0;
  std::vector<std::pair<std::uint64_t, ViewedRecording::Event>>
      events_;                         // events with the tick in which they took effect
  std::size_t timed_event_count_ = 0;  // number of events whose time is set
};

}  // namespace palpate
