#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "palpate/device/simulated_device.h"
#include "palpate/loading/loading.h"
#include "palpate/servo/servo_loop.h"

/// Timing measurements of the servo: along the path of a palpation, paced by the real clock next to an empty
/// loop, and free-running. Used by `palpate verify latency` and bench/servo_bench.
namespace palpate {

/// Recorded motion of a simulated hand, tick by tick, for playback.
struct PalpationPath {
  double rate_hz = 1000;
  PlantDevice device;
  PlantHand hand;
  WorkspaceSettings workspace;
  Parameters parameters;
  std::vector<DeviceState> states;             ///< Input of each tick
  std::vector<Point<World>> intended;          ///< Intended position of the hand after each tick
  double in_contact = 0;                       ///< Fraction of the ticks in contact, 0 ... 1
  std::size_t touch_begin = 0, touch_end = 0;  ///< Range of ticks of the longest continuous contact
};

/// Records a path on the virtual clock: that of the script of the scene (the default one of set_up_run),
/// with a stationary object, and with a stroke of 5 mm on every structure before it is left. Errors: those
/// of the script; kBadInput if nothing is touched; kInterrupted.
Result<PalpationPath> palpate_once(const LoadedScene& loaded, const Progress& progress = {});

// ---- paced by the real clock

struct PaceSettings {
  double rate_hz = 1000;  ///< Rate of both loops; kMinRate_hz ... kMaxRate_hz
  double spin_s = 0;      ///< LoopSettings::spin_s, for both loops
  bool realtime = true;   ///< LoopSettings::realtime, for both loops
  int cpu = -1;           ///< LoopSettings::cpu, for both loops
};

/// Lateness of both loops at the same percentile.
struct LatenessPair {
  double servo_us = 0, bare_us = 0;
};

/// Figures over all blocks so far. `compute` is LoopHealth's: from input samples to output commands.
struct PaceFigures {
  Percentiles compute, lateness, bare_lateness;
  /// Lateness of the pair of adjacent blocks with the median ratio of all pairs. A single pair is as much
  /// affected by other load on the machine.
  LatenessPair typical_p50, typical_p99;
  /// Lateness of the pair with the lower-quartile ratio of all pairs. The program's own overhead occurs in
  /// every pair, whereas other load hits one loop in one pair and the other loop in another.
  LatenessPair min_p50, min_p99;
  std::uint64_t ticks = 0, skipped = 0, dropped = 0;
  std::uint64_t bare_ticks = 0, bare_skipped = 0;
  double on_time = 1;     ///< Fraction of punctual ticks, as LoopHealth::on_time
  double in_contact = 0;  ///< Fraction of the ticks in contact, 0 ... 1
  LateCounts late;
  Scheduling scheduling;  ///< Scheduling of the servo loop
};

/// Compares the servo on the real clock, with a simulated hand that strokes a structure back and forth and a
/// recorder that drains the ring, with a bare loop that waits for the same points in time and does nothing.
/// Blocks of the two alternate, so that both see the same load; shorter blocks are better in this respect.
/// Adjacent servo and bare blocks, in either order, are a pair.
class PaceMeter {
 public:
  /// @param path  has to outlive the meter
  static std::unique_ptr<PaceMeter> create(std::shared_ptr<const Model> model, const PalpationPath& path,
                                           const PaceSettings& settings);
  virtual ~PaceMeter() = default;
  /// Warms up for a tenth of a second, then measures for `seconds`. Errors: those of ServoLoop::start,
  /// kInterrupted.
  virtual Result<void> servo_block(double seconds, const Progress& progress = {}) = 0;
  /// Errors: kInterrupted.
  virtual Result<void> bare_block(double seconds, const Progress& progress = {}) = 0;
  virtual PaceFigures figures() const = 0;
};

// ---- free-running

/// Runs ticks back to back along the whole path by a method that the model is ready for, on the calling
/// thread. Returns the processor time per tick, ns, for each round.
std::vector<double> time_ticks(const Model& model, const PalpationPath& path, ForceMethod method, int rounds);

/// Cost of a tick relative to a reference computation that represents the speed of the machine at that
/// moment.
struct TickCost {
  double tick_ns = 0, bare_ns = 0;  ///< Processor time
  double ratio = 0;                 ///< Ratio tick_ns / bare_ns
};
/// Ticks as in time_ticks, in slices of a tenth of a millisecond, each followed by a slice of the reference:
/// the founding force at the same points, implemented plainly with seven scalar trilinear interpolations of
/// the model's field and their differences. Medians over all pairs of slices; disturbances longer than a
/// slice affect both.
TickCost time_ticks_beside_bare(const Model& model, const PalpationPath& path, ForceMethod method,
                                int rounds);

/// Durations of single ticks in contact, once along the path, in microseconds of wall-clock time, including
/// the cost of reading the clock (some 0.02) and preemption. Zeros if no tick is in contact.
Percentiles time_ticks_in_contact(const Model& model, const PalpationPath& path, ForceMethod method);

/// The servo loop's whole update without a clock: mapping, tick, heartbeat, snapshot, ring. The ring is
/// drained periodically, which is not timed. Returns the processor time per update, ns, for each round.
/// Errors: those of ServoLoop::start, kInterrupted.
Result<std::vector<double>> time_updates(std::shared_ptr<const Model> model, const PalpationPath& path,
                                         ForceMethod method, int rounds, const Progress& progress = {});

/// Median; for an even number of values the greater of the middle two. Requires at least one value.
double median(std::vector<double> values);

}  // namespace palpate
