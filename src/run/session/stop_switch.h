#pragma once

#include <atomic>
#include <cstdint>
#include <mutex>
#include <optional>
#include <string>

#include "palpate/recording/recording.h"
#include "palpate/server/viewer_host.h"
#include "session/arming_code.h"
#include "session/session_loop.h"

namespace palpate {

/// Stop switch of a session: stops the force at once, and re-arms it for authorised requesters.
///
///    stop() ── any thread, at any time ──► stopped ── rearm(), naming that stop ──► armed
///               └─ before there is a loop: applied by begin()
///
/// A stop needs neither consent nor the lock of the model (LiveModel), so that no preparation or carving can
/// delay it; its own lock is held only while the stop is passed to the loop. Thread-safe.
class StopSwitch {
 public:
  /// @param loop      outlives the switch
  /// @param physical  whether a device of the session can push
  StopSwitch(SessionLoop& loop, bool physical) : loop_(loop), physical_(physical) {}

  /// Passes on a stop that was requested before the loop was connected.
  void begin();

  void stop(RequestedBy by);
  /// Number of the stop in effect; empty if there is none.
  std::optional<std::uint32_t> current() const;
  /// Fills in the stop in effect, its originator, and whether a device is armed.
  void describe(ViewedState& state) const;

  /// Re-arms at a viewer's request, which for a physical device needs the current arming code.
  /// Errors: those of LiveHost::rearm.
  Result<void> rearm(const RearmRequest& request);
  /// Re-arms for an operator at this machine. Errors: the same, apart from the code.
  /// @param stop  number of the stop that was displayed to the operator
  Result<void> rearm(std::uint32_t stop, RequestedBy by);
  /// Code by which the page can re-arm a physical device after the current stop. It is accepted from the
  /// first call on. Empty if nothing is stopped, no device is physical, or too many wrong codes were entered.
  std::string arming_code();

 private:
  SessionLoop& loop_;
  const bool physical_;
  ArmingCode arming_code_;
  mutable std::mutex mutex_;  // guards requested_by_, and stops requested before there is a loop
  RequestedBy requested_by_;  // source of the last stop
  std::atomic<bool> stopped_early_{false};
};

}  // namespace palpate
