#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "palpate/base/heartbeat.h"
#include "palpate/base/result.h"

/// A process of its own that outlives the session's: whatever that dies of, and also where it stands still as
/// a whole (SIGSTOP, a debugger), which no thread within it can notice.
///
///    session's process                          supervisor                     device's process
///      servo thread ── heartbeat, shared ──────► looks each millisecond
///      watchdog     ◄── how often it halted ───   │
///      its end      ── pidfd ──────────────────►  └─ number on its halt file ──► no force
///
/// A device whose library lives in the session's process is not reached from here: when that process is gone
/// its handle is closed, and what happens then is the maker's own watchdog's
/// (docs/reference/device-port.md). So a process that holds such a device and stands still is ended.
namespace palpate {

struct SupervisorSettings {
  /// Program and arguments that call supervise() with what is appended to them.
  std::vector<std::string> command;
  /// Get the halt's number when the devices shall give no force (DeviceDriver::halt_file()); at most 8.
  std::vector<int> halt_files;
  /// A device lives in this process: where neither a tick nor the watchdog has been seen for half a second,
  /// the process is killed.
  bool kill_frozen = false;
  /// Gets a line of JSON for each event, with the fields of SupervisorEvent, the session's process and the
  /// wall clock: a record that outlives the session. Stays the caller's, and open. -1: none.
  int record_file = -1;
  bool realtime = true;  ///< ask for SCHED_FIFO and locked memory; refused, it watches without
};

/// What the supervisor has seen and done.
struct SupervisorEvent {
  enum class Kind : std::uint8_t {
    kStall,   ///< no tick ended for kSupervisedStall_ns; looked for where there are halt files
    kDeath,   ///< the process is gone without having ended its session
    kKilled,  ///< it stood still, and was ended
  };
  Kind kind = Kind::kStall;
  std::int64_t last_beat_ns = 0;  ///< end of the last tick, CLOCK_MONOTONIC
  std::int64_t seen_ns = 0;       ///< when it was noticed
  std::int64_t halted_ns = 0;     ///< when every halt file that had room had it
};

/// With a look each millisecond a device hears of it within 10 ms of the last tick.
inline constexpr std::int64_t kSupervisedStall_ns = 9'000'000;

class Supervisor {
 public:
  /// Starts the process, and returns when it watches. Errors: kUnavailable, when there is no process or no
  /// shared memory to be had, or the program does not call supervise().
  static Result<std::unique_ptr<Supervisor>> start(const SupervisorSettings& settings);
  virtual ~Supervisor() = default;

  /// For LoopSettings::heartbeat; lives as long as this.
  virtual Heartbeat& heartbeat() noexcept = 0;
  /// False: the supervisor itself has died, and nobody watches. Any thread.
  virtual bool watching() const noexcept = 0;
  /// Starts another process in the place of one that has died. Errors: those of start().
  virtual Result<void> watch_again() = 0;
  /// What its process got: "SCHED_FIFO 95", or what it is instead and why.
  virtual std::string scheduler() const = 0;
  /// The last 64 at most, oldest first.
  virtual std::vector<SupervisorEvent> events() const = 0;
};

/// The supervisor's whole life, in a process that Supervisor::start() made: until the session has ended or
/// died. Returns the exit code.
/// @param arguments  what start() appended to the command
int supervise(const std::vector<std::string>& arguments);

}  // namespace palpate
