#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "palpate/base/heartbeat.h"
#include "palpate/device/sweep_record.h"
#include "palpate/device/workspace.h"
#include "palpate/servo/servo.h"

/// The tick on the real clock: its thread, its watchdog, and the data it publishes.
///
///    change, set_model, emergency_stop                 any thread but the servo's
///         │ mailbox, pointer, flag: the servo never waits
///         ▼
///    servo thread   clock ─► samples ─► workspace ─► tick ─► workspace ─► commands
///         │             │                             │
///         │             └─ heartbeat ─► watchdog      ├─ latest value ─► snapshot(): viewers, publishers
///         │                             halts a       └─ every tick, ring ─► ring(): recorder
///         │                             hung device
///
/// No reader can delay a tick: the latest value is overwritten, and a full ring drops the record and counts
/// it.
namespace palpate {

template <class T>
class SpscRing;

/// Range of tick rates, Hz.
inline constexpr double kMinRate_hz = 250, kMaxRate_hz = 10000;

/// Options of ServoLoop::start().
struct LoopSettings {
  /// Tick rate, kMinRate_hz ... kMaxRate_hz; ignored for devices with a clock of their own
  double rate_hz = 1000;
  double spin_s = 0;     ///< Busy-wait time before each tick, which replaces the end of the sleep; 0: never
  bool realtime = true;  ///< Request SCHED_FIFO and locked memory; if refused, the loop runs without them
  int cpu = -1;          ///< CPU to bind the servo thread to; -1: any
  /// The user has consented to arms that move by themselves (DeviceInfo::moves_by_itself)
  bool may_move = false;
  double ring_s = 2;  ///< Capacity of the recorder's ring; further ticks are dropped
  /// Memory shared with the supervisor process (supervisor.h); must outlive the loop. nullptr: none.
  Heartbeat* heartbeat = nullptr;
};

/// Privileges that the operating system granted the servo thread.
struct Scheduling {
  bool realtime = false;  ///< SCHED_FIFO
  bool memory_locked = false;
  std::string scheduler;  ///< "SCHED_FIFO 80", or the actual scheduler and the reason
  std::string memory;     ///< "locked", or the actual state and the reason
  std::string watchdog;   ///< Scheduler of the watchdog's thread, in the format of `scheduler`
};

/// Number of ticks that were not on time (LoopHealth::on_time), by the cause that the kernel's counters
/// indicate.
struct LateCounts {
  std::uint64_t steal = 0;  ///< The hypervisor gave the processor to another guest
  std::uint64_t page_fault = 0;
  std::uint64_t preemption = 0;  ///< Another thread took the processor
  std::uint64_t run_queue = 0;   ///< The thread was runnable and waited for a processor
  std::uint64_t unknown = 0;     ///< No counter indicates a cause
  std::uint64_t total() const { return steal + page_fault + preemption + run_queue + unknown; }
};

/// A thread that exchanges states and commands with devices, as reported by the system.
struct TickingThread {
  std::string device;  ///< Name of the first device
  /// In the format of Scheduling::scheduler; queried from the kernel for a vendor's thread
  std::string scheduler;
  std::uint64_t updates = 0;  ///< Number of updates since the thread started
  LateCounts late;            ///< Updates that were late by more than half a period
};

/// Percentiles and maximum of a duration.
struct Percentiles {
  double p50_us = 0, p99_us = 0, p999_us = 0, max_us = 0;
};

/// Timing statistics since the loop was started or last reset.
struct LoopHealth {
  std::uint64_t ticks = 0;
  std::uint64_t skipped = 0;  ///< Scheduled ticks that were skipped
  std::uint64_t dropped = 0;  ///< Ticks that are not recorded because the ring was full
  std::uint64_t stalls = 0;   ///< Number of times that the watchdog halted the devices
  double rate_hz = 0;         ///< Measured tick rate
  Percentiles lateness;       ///< Start of a tick relative to its grid point
  Percentiles compute;        ///< Time from receiving samples to returning commands
  /// Fraction of all grid points whose tick began within half a period and ended within a whole one.
  double on_time = 1;
  LateCounts late;
};

/// The last stop or rearm requested of a loop.
struct Arming {
  std::uint32_t number = 0;  ///< Sequence number, shared by stops and rearms, from 1; 0: there was none
  bool stopped = false;
};

/// Result of a rearm request.
enum class RearmResult : std::uint8_t {
  kDone,  ///< Accepted: the force ramps in, starting with the next tick if the tips are still in free space
  kNotStopped,    ///< No stop is active
  kStoppedAgain,  ///< Another stop followed the one that this request answers
  kNotApplied,    ///< No tick has taken the stop into account yet
  kTouching,      ///< A tip is in contact; the force is only restored in free space
};

/// A running servo loop: inputs from any thread, and its published outputs.
class ServoLoop {
 public:
  /// Opens the driver and starts the servo thread and its watchdog. The force ramps in over half a second.
  /// @param driver      must outlive the loop
  /// @param parameters  of each DeviceParameters only max_stiffness_N_per_mm, max_damping_N_s_per_mm (each
  ///                    where it is below the device's) and delay_s (where it is above the device's) are
  ///                    used; the rest follows from the driver and the workspaces
  /// @param workspaces  one for each device, or one for all
  /// Errors: kUsage if a setting is out of range or an arm would move without consent; the driver's errors.
  static Result<std::unique_ptr<ServoLoop>> start(std::shared_ptr<const Model> model, DeviceDriver& driver,
                                                  const Parameters& parameters,
                                                  const std::vector<WorkspaceSettings>& workspaces,
                                                  const LoopSettings& settings);
  /// Loop for a host without threads, such as a browser's worker: the caller ticks it by run(). It has
  /// neither a watchdog nor real-time scheduling, and LoopSettings::realtime, cpu and heartbeat are ignored.
  /// @param now  clock of the ticks
  /// Errors: those of start().
  static Result<std::unique_ptr<ServoLoop>> make_unthreaded(std::shared_ptr<const Model> model,
                                                            DeviceDriver& driver,
                                                            const Parameters& parameters,
                                                            const std::vector<WorkspaceSettings>& workspaces,
                                                            const LoopSettings& settings, TimeSource now);
  virtual ~ServoLoop() = default;

  /// Runs the driver on the calling thread until `clock` has no further tick. Only for a loop of
  /// make_unthreaded().
  virtual void run(ServoClock& clock) noexcept = 0;

  // ---- inputs: from any thread but the servo's; the servo never waits for the caller
  /// Edits the current parameters; they apply from the next tick on. Gains and limits of the devices are
  /// owned by the loop and keep their values. `edit` is called synchronously, under the lock that serialises
  /// all callers. Returns the number of this change, from 1; a tick has applied it if its
  /// TickRecord::settings_number is not lower.
  virtual std::uint32_t change(const std::function<void(Parameters&)>& edit) = 0;
  virtual Parameters parameters() const = 0;
  /// Replaces the model from the next tick on. The force blends over in kOutputSettings.blend_s, except for a
  /// local edit (Model::edits), which applies at once. A model with the current version number must be the
  /// same model, prepared for additional methods. The old model is freed by a later call of set_model() or
  /// collect(), never on the servo thread. Errors: kBadInput if the model is null or of a lower version; the
  /// loop then keeps its model.
  virtual Result<void> set_model(std::shared_ptr<const Model> model) = 0;
  /// Frees models that no tick uses any more. Returns the number of models still held.
  virtual std::size_t collect() = 0;
  /// Sets forces to zero from the next tick on, until a rearm() answers this stop or a later one. Idempotent.
  /// Any thread at any time, signal handlers included. Returns the stop's number, shared with rearm()'s; a
  /// tick has taken it into account if its TickRecord::arming_number is not lower.
  virtual std::uint32_t emergency_stop() noexcept = 0;
  /// Ends a stop if it is the latest one and no device is in contact. If a tip is in contact in the tick that
  /// would apply it, that tick stays stopped and the rearm is void. Any thread.
  /// @param stop    number of the latest stop known to the caller
  /// @param number  receives the number of the rearm if the result is kDone
  virtual RearmResult rearm(std::uint32_t stop, std::uint32_t& number) noexcept = 0;
  virtual Arming arming() const noexcept = 0;
  /// Fades the force out, then ends the servo thread and leaves the devices at zero force. The destructor
  /// calls it too. Takes a fifth of a second, longer if the servo thread hangs.
  virtual void stop() = 0;
  virtual bool running() const noexcept = 0;

  // ---- outputs
  /// Latest complete tick. Reading never delays the loop.
  virtual TickRecord snapshot() const = 0;
  /// All ticks in order, for one consumer (the recorder).
  virtual SpscRing<TickRecord>& ring() noexcept = 0;
  /// All sweeps that burrs have completed, for one consumer, which cuts them from the model and publishes it
  /// (Carving). Never overflows, because a burr stops cutting when too many of its sweeps are not carved yet.
  virtual SpscRing<SweepRecord>& sweeps() noexcept = 0;
  /// Number of burr strokes begun up to the latest tick; the sweeps in the ring belong to them.
  virtual std::uint32_t strokes() const noexcept = 0;
  virtual LoopHealth health() const = 0;
  /// Resets the statistics of health() with the next tick.
  virtual void reset_health() noexcept = 0;
  virtual const Scheduling& scheduling() const noexcept = 0;
  /// Thread that runs the ticks: the loop's own, or the vendor's callback thread.
  virtual TickingThread ticking() const = 0;
  /// CPU on which the latest tick ran, for threads that must avoid it; -1: no tick yet.
  virtual int cpu() const noexcept = 0;
  virtual std::span<const DeviceInfo> devices() const = 0;
};

}  // namespace palpate
