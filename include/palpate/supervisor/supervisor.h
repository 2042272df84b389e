#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "palpate/base/heartbeat.h"
#include "palpate/base/result.h"

/// Watchdog process that survives any termination of the session's process, and also detects that the whole
/// process is suspended (SIGSTOP, a debugger), which no thread of its own can detect.
///
///   session's process                          supervisor                     device's process
///     servo thread ── heartbeat, shared ──────► polls each millisecond
///     watchdog     ◄── number of halts ────────   │
///     its death    ── pidfd ──────────────────►  └─ number on its halt pipe ──► no force
///
/// A device whose library runs inside the session's process cannot be reached from here: when that process is
/// gone its handle is closed, and the vendor's own watchdog takes over (docs/reference/device-port.md). A
/// frozen process that holds such a device is therefore killed.
namespace palpate {

/// Settings of Supervisor::start().
struct SupervisorSettings {
  /// Program and arguments that call supervise() with the arguments appended to them.
  std::vector<std::string> command;
  /// Files that receive the number of a halt when the devices have to stop their force
  /// (DeviceDriver::halt_fd()); at most 8.
  std::vector<int> halt_fds;
  /// Whether this process holds a device itself: if neither a tick nor the watchdog has been observed for
  /// half a second, the process is killed.
  bool kill_frozen = false;
  /// Descriptor that receives a line of JSON per event, with the fields of SupervisorEvent, the session's
  /// process ID and the wall-clock time: a record that outlives the session. Owned by the caller; stays open.
  /// -1: none.
  int event_log_fd = -1;
  /// Request SCHED_FIFO and locked memory; without permission it runs as an ordinary process
  bool realtime = true;
};

/// Event observed by the supervisor.
struct SupervisorEvent {
  enum class Kind : std::uint8_t {
    kStall,   ///< No tick ended for kSupervisedStall_ns; detected only if there are halt files
    kDeath,   ///< The process died without ending its session
    kKilled,  ///< The process was frozen, and was killed
  };
  Kind kind = Kind::kStall;
  std::int64_t last_beat_ns = 0;  ///< End of the last tick; CLOCK_MONOTONIC
  std::int64_t observed_ns = 0;   ///< Time of detection; CLOCK_MONOTONIC
  /// Time at which every halt pipe that had room had received the halt; CLOCK_MONOTONIC
  std::int64_t halted_ns = 0;
};

/// Stall threshold. With a polling period of a millisecond a device receives the halt within 10 ms of the
/// last tick.
inline constexpr std::int64_t kSupervisedStall_ns = 9'000'000;

/// Handle of the supervisor process in the supervised session.
class Supervisor {
 public:
  /// Starts the process, and returns once it watches. Errors: kUnavailable if a process or shared memory
  /// cannot be created, or the program does not call supervise().
  static Result<std::unique_ptr<Supervisor>> start(const SupervisorSettings& settings);
  virtual ~Supervisor() = default;

  /// For LoopSettings::heartbeat; valid for the lifetime of this object.
  virtual Heartbeat& heartbeat() noexcept = 0;
  /// False: the supervisor process has died, so the session is unsupervised. Thread-safe.
  virtual bool is_running() const noexcept = 0;
  /// Replaces a dead supervisor process. Errors: those of start().
  virtual Result<void> restart() = 0;
  /// Scheduling of the supervisor's process: "SCHED_FIFO 95", or the fallback and its reason.
  virtual std::string scheduler() const = 0;
  /// Up to 64 most recent events, oldest first.
  virtual std::vector<SupervisorEvent> events() const = 0;
};

/// Main function of the supervisor's process, which Supervisor::start() creates; returns an exit code once
/// the session has ended or died.
/// @param arguments  arguments that start() appended to the command
int supervise(const std::vector<std::string>& arguments);

}  // namespace palpate
