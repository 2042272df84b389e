#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "palpate/base/heartbeat.h"
#include "palpate/device/workspace.h"
#include "palpate/servo/servo.h"

/// The tick on the real clock: its thread, its safety, and what others may see of it.
///
///    change, set_model, emergency_stop                 any thread but the servo's
///         │ mailbox, pointer, flag: never waited for
///         ▼
///    servo thread   clock ─► samples ─► workspace ─► tick ─► workspace ─► commands
///         │             │                             │
///         │             └─ heartbeat ─► watchdog      ├─ latest value ─► snapshot(): viewers, publishers
///         │                             halts a       └─ every tick, ring ─► ring(): recorder
///         │                             hung device
///
/// Nothing on the right can make a tick wait: the latest value is overwritten, a full ring counts a drop.
namespace palpate {

template <class T>
class SpscRing;

inline constexpr double kLowestRate_hz = 250, kHighestRate_hz = 10000;

struct LoopSettings {
  double rate_hz = 1000;  ///< kLowestRate_hz ... kHighestRate_hz; of devices without a clock of their own
  double spin_s = 0;      ///< busy-wait that long before every tick instead of trusting the sleep; 0: never
  bool realtime = true;   ///< ask for SCHED_FIFO and locked memory; refused, the loop runs without
  int cpu = -1;           ///< the only CPU for the servo thread; -1: any
  bool may_move = false;  ///< the user has agreed that an arm moves by itself (DeviceInfo::moves_by_itself)
  double ring_s = 2;      ///< how many seconds of ticks wait for the recorder before they are dropped
  /// Where another process watches (supervisor.h); outlives the loop. nullptr: none does.
  Heartbeat* heartbeat = nullptr;
};

/// What the operating system gave the servo thread.
struct Scheduling {
  bool realtime = false;  ///< SCHED_FIFO
  bool memory_locked = false;
  std::string scheduler;  ///< "SCHED_FIFO 80", or what it is instead and why
  std::string memory;     ///< "locked", or what it is instead and why
  std::string watchdog;   ///< as scheduler, of the watchdog's thread
};

/// How many ticks were not on time (LoopHealth::on_time), by what the system tells of them.
struct LateCounts {
  std::uint64_t steal = 0;  ///< the hypervisor gave the processor to somebody else
  std::uint64_t page_fault = 0;
  std::uint64_t preemption = 0;  ///< another thread took the processor
  std::uint64_t run_queue = 0;   ///< the thread was ready and had to wait for a processor
  std::uint64_t unknown = 0;     ///< the system tells of no cause
  std::uint64_t total() const { return steal + page_fault + preemption + run_queue + unknown; }
};

/// A thread that exchanges states and commands with devices, as the system sees it.
struct TickingThread {
  std::string device;         ///< name of the first device
  std::string scheduler;      ///< as Scheduling::scheduler; of a vendor's thread what it is
  std::uint64_t updates = 0;  ///< since it began
  LateCounts late;            ///< updates that came later than half a period
};

struct Percentiles {
  double p50_us = 0, p99_us = 0, p999_us = 0, max_us = 0;
};

/// How the loop has kept time since it was started, or since the last reset.
struct LoopHealth {
  std::uint64_t ticks = 0;
  std::uint64_t skipped = 0;  ///< points in time that passed without a tick
  std::uint64_t dropped = 0;  ///< ticks that found the ring full and are not recorded
  std::uint64_t stalls = 0;   ///< times that the watchdog halted the devices
  double rate_hz = 0;         ///< ticks a second, measured
  Percentiles lateness;       ///< of a tick's begin behind its point in time
  Percentiles compute;        ///< from samples in to commands out
  /// Part of all points in time at which a tick began within half a period and ended within a whole one.
  double on_time = 1;
  LateCounts late;
};

/// The last stop or rearm that a loop was told.
struct Arming {
  std::uint32_t number = 0;  ///< stops and rearms are counted together, from 1; 0: there was none
  bool stopped = false;
};

/// What became of a rearm.
enum class Rearmed : std::uint8_t {
  kDone,          ///< the force comes in by the ramp, from the next tick on in which the tip is still free
  kNotStopped,    ///< nothing is stopped
  kStoppedAgain,  ///< there was another stop after the one that it answers
  kUnheard,       ///< no tick has heard of the stop yet
  kTouching,      ///< a tip touches something: only a free hand gets its force back
};

class ServoLoop {
 public:
  /// Opens the driver, starts the servo thread and its watchdog. The force comes in over half a second.
  /// @param driver      outlives the loop
  /// @param parameters  of the devices the most stiffness alone, where it is less than what the driver
  /// vouches
  ///                    for: the rest is what the driver and the workspaces say
  /// @param workspaces  one for each device, or one for all
  /// Errors: kUsage for settings out of range, or when an arm would move without consent; what the driver
  /// says.
  static Result<std::unique_ptr<ServoLoop>> start(std::shared_ptr<const Model> model, DeviceDriver& driver,
                                                  const Parameters& parameters,
                                                  const std::vector<WorkspaceSettings>& workspaces,
                                                  const LoopSettings& settings);
  virtual ~ServoLoop() = default;

  // ---- inputs: from any thread but the servo's, which never waits for one
  /// Edits the parameters as they are now, for the next tick on. Gains and limits of the devices stay: they
  /// are the loop's own. `edit` is called at once, under the lock of all callers. The number of this change,
  /// from 1: ticks have felt it when TickRecord::settings_number is not below it.
  virtual std::uint32_t change(const std::function<void(Parameters&)>& edit) = 0;
  virtual Parameters parameters() const = 0;
  /// From the next tick on; the force turns into the new one over kOutputFeel.blend_s, but for a local edit
  /// (Model::edits), which is felt as it is. One of the same version is ready for more methods, and else the
  /// same; a lower version is a bug. The old one is freed by a later call of set_model() or collect(), never
  /// on the servo thread.
  virtual void set_model(std::shared_ptr<const Model> model) = 0;
  /// Frees models that no tick uses any more; how many are still held.
  virtual std::size_t collect() = 0;
  /// Forces off from the next tick on, until a rearm() that answers this stop or a later one: it only ever
  /// stops, however often it is called. Any thread at any time, signal handlers included. Its number, counted
  /// with those of rearm(): ticks have heard of it when TickRecord::arming_number is not below it.
  virtual std::uint32_t emergency_stop() noexcept = 0;
  /// Ends a stop, where it is the last one and no device touches anything. A tick in which one does after all
  /// stays stopped, and the rearm is void. Any thread.
  /// @param stop  number of the stop that whoever rearms has seen
  /// @param number  becomes that of the rearm, where it is done
  virtual Rearmed rearm(std::uint32_t stop, std::uint32_t& number) noexcept = 0;
  virtual Arming arming() const noexcept = 0;
  /// Lets the force fade out, then ends the servo thread and leaves the devices at zero. Called by the
  /// destructor too; takes a fifth of a second, a hung servo thread apart.
  virtual void stop() = 0;
  virtual bool running() const noexcept = 0;

  // ---- outputs
  /// The latest whole tick; ticks that others look at never make the loop wait.
  virtual TickRecord snapshot() const = 0;
  /// Every tick, for one consumer (the recorder).
  virtual SpscRing<TickRecord>& ring() noexcept = 0;
  /// Every sweep that a burr has finished, for one consumer, which sets a model that is cut by it
  /// (Carving). It never runs full: a burr whose sweeps are not cut cuts no more.
  virtual SpscRing<SweepRecord>& sweeps() noexcept = 0;
  /// How many strokes of a burr have begun until the latest tick, whose sweeps in the ring belong to them.
  virtual std::uint32_t strokes() const noexcept = 0;
  virtual LoopHealth health() const = 0;
  /// Begins the figures of health() anew, with the next tick.
  virtual void reset_health() noexcept = 0;
  virtual const Scheduling& scheduling() const noexcept = 0;
  /// The thread that ticks: the loop's, or a vendor's that calls back.
  virtual TickingThread ticking() const = 0;
  /// The CPU that the latest tick ran on, for who would keep off it; -1: there was none yet.
  virtual int cpu() const noexcept = 0;
  virtual std::span<const DeviceInfo> devices() const = 0;
};

}  // namespace palpate
