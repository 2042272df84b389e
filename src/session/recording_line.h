#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "palpate/link/viewer_server.h"
#include "palpate/recording/recording.h"

namespace palpate {

/// What a time line shows of a recording, gathered as its ticks go by: memory for it does not depend on how
/// many there are.
class RecordingLine {
 public:
  /// A shorter break does not end a contact: nobody would see it.
  static constexpr double kBreak_s = 0.05;
  static constexpr std::size_t kMostContacts = 2000, kMostEvents = 2000, kForces = 1000;

  /// @param head  of the recording whose ticks follow
  explicit RecordingLine(const RecordingHead& head);
  void see(const RecordingPart& part);
  /// After the last part.
  ViewedRecording take();

 private:
  void see(const TickRecord& tick);
  void see(const RecordingEvent& event);
  void see(int device, const DeviceTick& tick, double time_s);
  void end(ViewedRecording::Contact& contact);
  void drop_short_contacts();

  const double rate_hz_;
  const int devices_;
  ViewedRecording line_;
  ViewedRecording::Contact open_[kMaxDevices];  // what each device touched last; of no label: nothing yet
  std::uint64_t seen_ = 0;
  std::vector<std::pair<std::uint64_t, ViewedRecording::Event>>
      events_;             // with the tick in which they took hold
  std::size_t timed_ = 0;  // of them have their time
};

}  // namespace palpate
