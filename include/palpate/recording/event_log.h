#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <list>
#include <mutex>
#include <optional>

#include "palpate/recording/recording.h"

namespace palpate {

/// Log of external commands on their way to the recorder. The servo cannot store events, so each tick only
/// contains counters of the commands that it has acknowledged (TickRecord's model_version, solver_frame,
/// settings_number, arming_number), and the recorder determines each event's tick from them:
///
///    caller    append(): announced ── applied to the loop ── event stored ── announcement over
///    servo                                 └─ ticks with the next counter value ─► ring
///    recorder    ticks out of the ring ── wait for pending announcements ── events taken
///
/// An event is announced before a tick can acknowledge it, and stored before its announcement is over. A
/// thread that takes ticks first and then waits for the announcements therefore has every event that these
/// ticks acknowledge. Commands that overtake each other between two ticks are acknowledged by the same tick.
/// Thread-safe.
class EventLog {
 public:
  /// @param apply  carries the command out and returns its event, without the tick; empty if nothing was
  ///               done. If it throws, no event is logged.
  void append(const std::function<std::optional<RecordingEvent>()>& apply);
  /// Appends the events since the last call to `rows`. Waits for pending announcements, which takes as long
  /// as a change of the loop's parameters or model.
  void take(std::list<RecordingEvent>& rows);

 private:
  std::mutex mutex_;  // guards the members below; not held while a command is applied
  std::condition_variable over_;
  std::list<std::uint64_t> announced_;  // numbers of pending announcements, ascending
  std::uint64_t announcements_ = 0;
  std::list<RecordingEvent> rows_;
};

}  // namespace palpate
