#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "palpate/device/simulated_device.h"
#include "palpate/loading/loading.h"
#include "palpate/servo/servo_loop.h"

/// Measuring the servo: along the path of a real palpation, at a pace beside a loop with nothing in it, and
/// as fast as it goes. What `palpate verify latency` and bench/servo_bench are made of.
namespace palpate {

/// What a simulated hand did and felt, tick by tick, so that it can be done again.
struct PalpationPath {
  double rate_hz = 1000;
  PlantDevice device;
  PlantHand hand;
  WorkspaceSettings workspace;
  Parameters parameters;
  std::vector<DeviceState> states;             ///< what each tick was told
  std::vector<Point<World>> intended;          ///< where the hand then wanted to be
  double in_contact = 0;                       ///< part of the ticks that met tissue, 0 ... 1
  std::size_t touch_begin = 0, touch_end = 0;  ///< ticks of the longest unbroken contact
};

/// The path of the scene's own script (default_script_text) on the virtual clock, the object unturned, and
/// every structure stroked for 5 mm before it is left.
/// Errors: those of the script, kBadInput when nothing is touched, kInterrupted.
Result<PalpationPath> palpate_once(const LoadedScene& loaded, const Progress& progress = {});

// ---- at a pace

struct PaceSettings {
  double rate_hz = 1000;  ///< kMinRate_hz ... kMaxRate_hz
  double spin_s = 0;      ///< LoopSettings::spin_s, for both loops
  bool realtime = true;   ///< LoopSettings::realtime, for both loops
  int cpu = -1;           ///< LoopSettings::cpu, for both loops
};

/// The same percentile of both loops' lateness.
struct LatenessPair {
  double servo_us = 0, bare_us = 0;
};

/// Of all blocks so far. compute is LoopHealth's: from samples in to commands out.
struct PaceFigures {
  Percentiles compute, lateness, bare_lateness;
  /// Of the pair of neighbouring blocks whose ratio is the middle one of all such pairs: one pair alone says
  /// as much about who else ran just then.
  LatenessPair typical_p50, typical_p99;
  /// Of the pair whose ratio a quarter of all pairs do not reach. What the program adds, it adds in every
  /// pair; what others take hits one loop here and the other there.
  LatenessPair min_p50, min_p99;
  std::uint64_t ticks = 0, skipped = 0, dropped = 0;
  std::uint64_t bare_ticks = 0, bare_skipped = 0;
  double on_time = 1;     ///< LoopHealth::on_time
  double in_contact = 0;  ///< part of the ticks that met tissue, 0 ... 1
  LateCounts late;
  Scheduling scheduling;  ///< what the servo loop got
};

/// The servo on the real clock with a simulated hand that strokes a structure to and fro, its ticks taken
/// from the ring by a recorder; and the bare loop, which waits for the same points in time and does nothing.
/// Blocks of the two in turn meet the same machine, the more so the shorter they are; a servo block and a
/// bare block, in whichever order, are a pair.
class PaceMeter {
 public:
  /// @param path  outlives the meter
  static std::unique_ptr<PaceMeter> create(std::shared_ptr<const Model> model, const PalpationPath& path,
                                           const PaceSettings& settings);
  virtual ~PaceMeter() = default;
  /// A tenth of a second to warm up, then `seconds` that count. Errors: those of ServoLoop::start,
  /// kInterrupted.
  virtual Result<void> servo_block(double seconds, const Progress& progress = {}) = 0;
  /// Error kInterrupted.
  virtual Result<void> bare_block(double seconds, const Progress& progress = {}) = 0;
  virtual PaceFigures figures() const = 0;
};

// ---- as fast as it goes

/// Ticks one after the other along the whole path by a method that the model is prepared for, on the calling
/// thread: ns of processor time a tick, one value a round.
std::vector<double> time_ticks(const Model& model, const PalpationPath& path, ForceMethod method, int rounds);

/// Of a tick, and of a peer that says what this machine is worth at that moment.
struct TickCost {
  double tick_ns = 0, bare_ns = 0;  ///< of processor time
  double ratio = 0;                 ///< tick over peer
};
/// Ticks as time_ticks takes them, in slices of a tenth of a millisecond, each beside a slice of the founding
/// force alone at the same places, written out plainly: seven trilinear interpolations of the model's field,
/// one voxel after the other, and their differences. Medians over all pairs of slices: what makes the machine
/// slow for longer than a slice makes both slow.
TickCost time_ticks_beside_bare(const Model& model, const PalpationPath& path, ForceMethod method,
                                int rounds);

/// Single ticks of the same, once along the path, those in free space left out: microseconds by the wall
/// clock, what reading it costs (some 0.02) and what others take of the processor included. Zeros when no
/// tick touches.
Percentiles time_ticks_in_contact(const Model& model, const PalpationPath& path, ForceMethod method);

/// The servo loop's whole update without a clock: mapping, tick, heartbeat, snapshot, ring. The ring is
/// emptied now and then, which is not timed. ns of processor time an update, one value a round.
/// Errors: those of ServoLoop::start, kInterrupted.
Result<std::vector<double>> time_updates(std::shared_ptr<const Model> model, const PalpationPath& path,
                                         ForceMethod method, int rounds, const Progress& progress = {});

/// The middle value; of an even number the greater of the two middle ones. At least one value.
double median(std::vector<double> values);

}  // namespace palpate
