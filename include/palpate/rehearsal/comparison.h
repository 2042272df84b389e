#pragma once

#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/device/telemetry.h"
#include "palpate/recording/recording.h"
#include "palpate/rehearsal/plan_in_scene.h"
#include "palpate/rehearsal/structure_distance.h"

/// What was done, from a recording's ticks, beside what was planned. docs/guide/rehearsal.md says what each
/// figure is. Places are the patient's, LPS, mm; times count from the recording's first tick.
///
/// **The tip** is that of one device's tool: where the hand held it, of a burr or shaver where its head was
/// held (the middle of the ball at its tip), which is where it cuts. The tool's *head* is the ball at its
/// tip, of a cylinder or cone all of the row.
namespace palpate {

/// A figure with what the plan allows of it.
struct PlannedFigure {
  double value = kNotKnown;
  std::optional<double> allowed;                                         ///< of its amount, either way
  bool kept() const { return !allowed || std::abs(value) <= *allowed; }  ///< what is not known is not kept
};

/// How the entry made is known.
enum class EntryMade : std::uint8_t {
  kNone,     ///< there is none: the structures were never reached
  kPassed,   ///< the tip went through their surface
  kTouched,  ///< it never did, but touched them
  kNearest,  ///< the plan names no structures: the place of the way that is nearest to the planned entry
};
const char* word_of(EntryMade made);  ///< "passed", ...; "none"

/// A tick and where the tip was.
struct PlaceInRun {
  std::uint64_t tick = 0;
  double time_s = 0;
  Point<Patient> at;
};

/// Of a PlanTrajectory. A *way* begins with the entry and ends where the tip is 10 mm clear of the structures
/// (or of the plane across the trajectory in its entry). Of several ways in a run the one that came nearest
/// to the target counts.
struct TrajectoryDone {
  EntryMade entry_made = EntryMade::kNone;
  PlaceInRun entry, nearest, deepest;  ///< the last: nearest to the target; farthest along the trajectory
  PlannedFigure entry_error_mm;        ///< from the planned entry to the one made
  PlannedFigure target_error_mm;       ///< from the target to the nearest place of the way
  /// Parts of that: across the trajectory, and along it, positive beyond the target.
  double lateral_mm = kNotKnown, along_mm = kNotKnown;
  /// Between the trajectory and the line that fits the way from the entry to the deepest place best (least
  /// squares of the distances from it, each piece of the way by its length), 0 ... 180. Not known below 1 mm.
  PlannedFigure angle_deg;
  double off_line_mm = kNotKnown;  ///< root of the mean square of these distances
  double depth_mm = kNotKnown;     ///< from the entry made to the deepest place, along the trajectory
  PlannedFigure depth_error_mm;    ///< that less the trajectory's length: positive too deep
  /// Between the trajectory and the tool's shaft at the deepest place; of tools that have one (a burr's
  /// spindle, else the longest capsule), where the device told how the tool was turned.
  double shaft_deg = kNotKnown;

  bool kept() const {
    return entry_error_mm.kept() && target_error_mm.kept() && angle_deg.kept() && depth_error_mm.kept();
  }
};

/// mm3.
struct VolumeDone {
  double planned_mm3 = 0, taken_mm3 = 0;
  double left_mm3() const { return planned_mm3 - taken_mm3; }
};
/// Of a structure what was planned, what of that was taken, and what was taken outside of the plan.
struct StructureVolume {
  LabelId label = 0;
  VolumeDone in_plan;
  double outside_mm3 = 0;
};

/// How near the tool's head came to a structure: its gap is from the head's outside to the surface as
/// prepared, negative where it reached inside.
struct StructureApproach {
  LabelId label = 0;
  double nearest_mm = kNotKnown;
  PlaceInRun nearest;
  std::optional<double> asked_mm;  ///< to keep away
  double below_s = 0;              ///< time within that
  /// The least in each of PlanComparison::times_s; NaN where no tick had a place.
  std::vector<float> over_time_mm;

  bool kept() const { return !asked_mm || nearest_mm >= *asked_mm; }
};
/// A time in which a distance was not kept.
struct DistanceBreach {
  LabelId label = 0;
  double asked_mm = 0, nearest_mm = 0;
  PlaceInRun begin, nearest;
  std::uint64_t last_tick = 0;
  double end_s = 0;
};

struct PlanComparison {
  std::uint64_t ticks = 0;
  std::uint64_t without_place = 0;            ///< of them: the tip was not finite
  double time_s = 0;                          ///< from the first to the last
  bool cut_short = false;                     ///< the recording was
  double missing_s = 0;                       ///< in gaps of more than one tick's number
  std::vector<TrajectoryDone> trajectories;   ///< as the plan has them
  std::vector<VolumeDone> regions;            ///< likewise
  std::vector<StructureVolume> volumes;       ///< of structures that are in the plan or of which was taken
  std::vector<StructureApproach> approaches;  ///< of every structure, as structure_distances() has them
  std::vector<double> times_s;           ///< where parts of the run begin: kMaxPlanTimes equal ones at most
  std::vector<DistanceBreach> breaches;  ///< the first kMaxBreaches, in the order in which they begin
  std::uint64_t more_breaches = 0;       ///< beyond these
  std::vector<Point<Patient>> way;       ///< of the tip, thinned out to kMaxWayPlaces

  /// All that the plan asks was kept, the recording was not cut short, and no tick is missing: what nobody
  /// saw may have been beyond a bound. Volumes have no bound.
  bool kept() const;
};
inline constexpr std::size_t kMaxPlanTimes = 400, kMaxBreaches = 1000, kMaxWayPlaces = 4000;

/// Reads the recording once, in memory that does not depend on its length, but for what a burr took away.
/// @param model   as the recording began with
/// @param distances  of structure_distances(model)
/// @param device  whose tool it is, 0 the first
/// Errors: those of reading it; kBadInput where it has no tick, no such device, or where its clock goes back.
Result<PlanComparison> compare_recording(const PlanInScene& plan, const Model& model,
                                         const std::vector<StructureDistance>& distances,
                                         const RecordingSource& recording, std::size_t device = 0,
                                         const Progress& progress = {});

}  // namespace palpate
