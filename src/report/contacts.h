#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "palpate/haptics/haptics.h"
#include "palpate/recording/recording.h"
#include "report/timed_ticks.h"

/// What happened in a run, worked out from its ticks as they are read: when which structure was touched, how
/// hard, how deep. Each of these is shown every tick in order. Times are on the run's own clock, in s.
namespace palpate::report {

/// Magnitude of the force sent; 0 where it is not finite.
double force_N(const DeviceTick& device);

/// Ticks first ... last (inclusive) during which one device touched one structure without a break.
struct Contact {
  int device = 0;
  LabelId label = 0;
  std::size_t first = 0, last = 0;
  std::size_t peak = 0;  ///< the first tick with the largest force
  double begin_s = 0, end_s = 0;
  std::array<double, 3> first_touch_mm{};  ///< where the proxy was then, in Patient
  double peak_force_N = 0, peak_s = 0;     ///< the largest force, and when it was

  double duration_s() const { return end_s - begin_s; }
};

inline constexpr double kShortestContact_s = 0.05;
/// A structure that was touched for less than this in all was touched in passing.
inline constexpr double kPassing_s = 0.5;

/// Contacts that last at least `shortest_s`.
class ContactFinder {
 public:
  explicit ContactFinder(int devices, double shortest_s = kShortestContact_s)
      : shortest_s_(shortest_s), open_(static_cast<std::size_t>(devices)) {}
  void see(const TimedTick& now);
  /// After the last tick; by their first tick.
  std::vector<Contact> finish();

 private:
  void close(std::optional<Contact>& contact);

  double shortest_s_;
  std::vector<std::optional<Contact>> open_;  // of each device
  std::vector<Contact> found_;
};

/// One structure over the whole run: every tick that touched it, brief ones too. Means are over time.
struct StructureFigures {
  LabelId label = 0;
  int contacts = 0;  ///< of those that ContactFinder found
  double contact_s = 0;
  double mean_force_N = 0, peak_force_N = 0;
  /// The largest that was measured. Negative: felt only in front of its surface, in the smoothed rim.
  /// NaN: never measured.
  double max_depth_mm = std::numeric_limits<double>::quiet_NaN();
  bool depth_has_gaps = false;        ///< in some tick no surface was within reach
  bool in_front = false;              ///< in some tick it was felt in front of its surface
  bool deeper_than_measured = false;  ///< in one of these the tip was deep inside
  double mean_speed_mm_s = 0;

  bool in_passing() const { return contact_s < kPassing_s - 1e-9; }
};

/// Whether the tip is so deep inside what it touches that no surface was within reach: the depth is NaN,
/// and the field at least half that of the structure. (It is NaN in front of a structure, too, where the
/// normal leads past it.) Yes where the model does not know the structure.
bool is_deeper_than_measured(const DeviceTick& device, const Model& model);

/// The figures of each structure.
class StructureMeter {
 public:
  /// @param model  outlives the meter
  StructureMeter(int devices, const Model& model) : devices_(devices), model_(model) {}
  void see(const TimedTick& now);
  /// After the last tick, in the order in which structures were first touched.
  std::vector<StructureFigures> finish(const std::vector<Contact>& contacts);

 private:
  int devices_;
  const Model& model_;
  std::vector<StructureFigures> figures_;  // sums instead of means
  std::map<LabelId, std::size_t> place_;
};

/// What gave part of the force while something around it was touched, over the whole run.
struct BeneathFigures {
  LabelId label = 0;
  double time_s = 0;
  double peak_force_N = 0;  ///< the largest that it gave: its share of the force sent
  double max_depth_mm = 0;  ///< the most of the tip's way in that lay within it
};

/// The figures of each structure that was felt through others.
class BeneathMeter {
 public:
  explicit BeneathMeter(int devices) : devices_(devices) {}
  void see(const TimedTick& now);
  /// After the last tick, in the order in which structures were first felt so.
  std::vector<BeneathFigures> finish() { return std::move(figures_); }

 private:
  int devices_;
  std::vector<BeneathFigures> figures_;
  std::map<LabelId, std::size_t> place_;
};

/// The longest contact of each structure; of more than `most` structures those touched longest in all.
/// By their first tick.
std::vector<Contact> main_contacts(const std::vector<Contact>& contacts,
                                   const std::vector<StructureFigures>& structures, std::size_t most);

/// The recording's summary; counted from the ticks when the run was cut short, and then without `skipped`,
/// which no tick tells of, and with the gaps between the ticks as `dropped`.
class SummaryMeter {
 public:
  void see(const TickRecord& tick);
  RecordingSummary finish(const RecordingHead& head) const;

 private:
  RecordingSummary counted_;
  std::uint64_t first_tick_ = 0, last_tick_ = 0;
};

/// After these the safety stage sent something else than was computed, or nothing. A pause and a clutch are
/// the user's, and outside the volume there is nothing to send.
inline constexpr std::uint32_t kInterventionFlags =
    kFaultFlags | kFlagClamped | kFlagRotationIgnored | kFlagThermal | kFlagSlew | kFlagStale;
/// Ticks with one of these flags on any device.
struct TickCount {
  std::uint32_t flags = 0;
  std::uint64_t ticks = 0;
  void see(const TickRecord& tick, int devices);
};

/// The limit that one device was held to; NaN where a fault or an old pose left nothing to limit.
double limit_N(const DeviceTick& device);

/// The largest force sent, the limits in force, and what the motors bore.
struct ForceExtremes {
  double peak_N = 0;
  double lowest_limit_N = 0, highest_limit_N = 0;
  /// Ticks whose force is larger than a limit recorded for that tick, or no number. palpate sends no such
  /// force: somebody changed the file.
  std::uint64_t above_limit = 0;
  double max_heat = 0;   ///< of the thermal budget, 0 ... 1, of any device
  bool limited = false;  ///< there was a limit

  void see(const TickRecord& tick, int devices);
};

/// 1 ... 4, whatever a damaged file says.
int device_count(const RecordingHead& head);

}  // namespace palpate::report
