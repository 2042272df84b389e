#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "palpate/contact/model.h"
#include "palpate/recording/recording.h"
#include "report/timed_ticks.h"

/// Contacts and summary statistics of a run, computed from its ticks while reading. Each class expects every
/// tick in order. Times are on the run's clock, in s.
namespace palpate::report {

/// Magnitude of the force sent; 0 if it is not finite.
double force_N(const DeviceTick& device);

/// Range of ticks first ... last (inclusive) in which one device was in continuous contact with one
/// structure.
struct Contact {
  int device = 0;
  LabelId label = 0;
  std::size_t first = 0, last = 0;
  std::size_t peak = 0;  ///< First tick with the largest force
  double begin_s = 0, end_s = 0;
  std::array<double, 3> first_touch_mm{};  ///< Proxy position at the first tick, patient frame
  double peak_force_N = 0, peak_s = 0;     ///< Largest force, and its time

  double duration_s() const { return end_s - begin_s; }
};

inline constexpr double kMinContact_s = 0.05;
/// Total contact duration below which a structure was touched only in passing.
inline constexpr double kPassing_s = 0.5;

/// Finds contacts that last at least `shortest_s`.
class ContactFinder {
 public:
  explicit ContactFinder(int devices, double shortest_s = kMinContact_s)
      : shortest_s_(shortest_s), open_(static_cast<std::size_t>(devices)) {}
  void observe(const TimedTick& now);
  /// Call after the last tick. Contacts in the order of their first tick.
  std::vector<Contact> finish();

 private:
  void close(std::optional<Contact>& contact);

  double shortest_s_;
  std::vector<std::optional<Contact>> open_;  // one per device
  std::vector<Contact> found_;
};

/// Statistics of one structure over the whole run, including brief contacts. Means are time-weighted.
struct StructureFigures {
  LabelId label = 0;
  int contacts = 0;  ///< Number of contacts found by ContactFinder
  double contact_s = 0;
  double mean_force_N = 0, peak_force_N = 0;
  /// Largest measured depth. Negative: contact only outside the surface, in the smoothed rim. NaN: not
  /// measured.
  double max_depth_mm = std::numeric_limits<double>::quiet_NaN();
  bool depth_has_gaps = false;        ///< Whether any tick had no surface within reach
  bool in_front = false;              ///< Whether any contact was outside the surface
  bool deeper_than_measured = false;  ///< Whether the tip was deep inside in any of the ticks without a depth
  double mean_speed_mm_s = 0;

  bool in_passing() const { return contact_s < kPassing_s - 1e-9; }
};

/// Whether the tip is deeper inside the touched structure than distances are available: the depth is NaN and
/// the field is at least half of the structure's level. (The depth is also NaN outside a structure where the
/// normal misses it.) True if the structure is unknown to the model.
bool is_deeper_than_measured(const DeviceTick& device, const Model& model);

/// Computes the statistics of each structure.
class StructureMeter {
 public:
  /// @param model  has to outlive the meter
  StructureMeter(int devices, const Model& model) : devices_(devices), model_(model) {}
  void observe(const TimedTick& now);
  /// Call after the last tick. Structures in the order of their first contact.
  std::vector<StructureFigures> finish(const std::vector<Contact>& contacts);

 private:
  int devices_;
  const Model& model_;
  std::vector<StructureFigures> figures_;  // sums, before the division that gives means
  std::map<LabelId, std::size_t> index_of_label_;
};

/// Force contribution of a structure beneath the touched one, over the whole run.
struct DeepFigures {
  LabelId label = 0;
  double time_s = 0;
  double peak_force_N = 0;  ///< Largest contribution: its share of the force sent
  double max_depth_mm = 0;  ///< Longest part of the penetration path within it
};

/// Computes the contributions of structures beneath the touched ones.
class BeneathMeter {
 public:
  explicit BeneathMeter(int devices) : devices_(devices) {}
  void observe(const TimedTick& now);
  /// Call after the last tick. Structures in the order of their first contribution.
  std::vector<DeepFigures> finish() { return std::move(figures_); }

 private:
  int devices_;
  std::vector<DeepFigures> figures_;
  std::map<LabelId, std::size_t> index_of_label_;
};

/// Longest contact of each structure, in the order of their first tick; if there are more than `max_count`
/// structures, those with the longest total contact.
std::vector<Contact> main_contacts(const std::vector<Contact>& contacts,
                                   const std::vector<StructureFigures>& structures, std::size_t max_count);

/// Summary of the recording. For a truncated recording it is counted from the ticks: `skipped` is unknown
/// then, and `dropped` is the number of missing ticks.
class SummaryMeter {
 public:
  void observe(const TickRecord& tick);
  RecordingSummary finish(const RecordingHead& head) const;

 private:
  RecordingSummary counted_;
  std::uint64_t first_tick_ = 0, last_tick_ = 0;
};

/// Flags of ticks in which the safety stage modified or suppressed the computed force. Pause and clutch are
/// excluded because the user requests them, and so is the space outside the volume, where there is no force.
inline constexpr std::uint32_t kInterventionFlags =
    kFaultFlags | kFlagClamped | kFlagRotationIgnored | kFlagThermal | kFlagSlew | kFlagStale;
/// Counts ticks with one of these flags on any device.
struct TickCount {
  std::uint32_t flags = 0;
  std::uint64_t ticks = 0;
  void observe(const TickRecord& tick, int devices);
};

/// Force limit that applied to one device; NaN if a fault or a stale pose suppressed the force.
double limit_N(const DeviceTick& device);

/// Largest force sent, the limits in effect, and the thermal load of the motors.
struct ForceExtremes {
  double peak_N = 0;
  double lowest_limit_N = 0, highest_limit_N = 0;
  /// Ticks with a force above the limit recorded for that tick, or not finite. palpate does not send such a
  /// force: the file was modified.
  std::uint64_t above_limit = 0;
  double max_heat = 0;   ///< Used fraction of the thermal budget, 0 ... 1, maximum over devices
  bool limited = false;  ///< Whether there was a limit

  void observe(const TickRecord& tick, int devices);
};

/// Number of devices, clamped to 1 ... 4 in case the file is damaged.
int device_count(const RecordingHead& head);

}  // namespace palpate::report
