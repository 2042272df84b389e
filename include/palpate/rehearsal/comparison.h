#pragma once

#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/device/telemetry.h"
#include "palpate/recording/recording_source.h"
#include "palpate/rehearsal/plan_in_scene.h"
#include "palpate/rehearsal/structure_distance.h"

/// Comparison of a recorded run with a plan. docs/guide/rehearsal.md defines each figure. Points are in the
/// patient frame (LPS, mm); times count from the first tick of the recording.
///
/// **The tip** is that of one device's tool: the tip as held by the operator or, for a burr or shaver, the
/// proxy of its head (the centre of the ball at its tip), which is where it cuts. The tool's *head* is the
/// ball at its tip, and for a cylinder or cone the whole row of balls.
namespace palpate {

/// A measured deviation with its tolerance from the plan.
struct ToleratedValue {
  double value = kNoValue;
  /// Tolerance of the absolute value; empty: none
  std::optional<double> allowed;
  /// An unknown value violates a tolerance
  bool is_within_limit() const { return !allowed || std::abs(value) <= *allowed; }
};

/// How the actual entry point was determined.
enum class EntryKind : std::uint8_t {
  kNone,     ///< No entry point: the structures were not reached
  kPassed,   ///< The tip passed through the structures' surface
  kTouched,  ///< The tip touched the structures without passing through
  kNearest,  ///< The plan names no structures: the point of the path nearest to the planned entry
};
const char* word_of(EntryKind kind);  ///< Name in reports: "passed", ..., "none"

/// A tick with the position of the tip.
struct RunPoint {
  std::uint64_t tick = 0;
  double time_s = 0;
  Point<Patient> at;
};

/// Actual execution of a PlanTrajectory. An *insertion* starts at the entry point and ends when the tip is 10
/// mm outside the structures (without structures: outside the plane through the planned entry, perpendicular
/// to the trajectory). Of several insertions in a run the one closest to the target is evaluated.
struct TrajectoryResult {
  EntryKind entry_kind = EntryKind::kNone;
  /// `nearest`: nearest to the target; `deepest`: farthest along the trajectory
  RunPoint entry, nearest, deepest;
  ToleratedValue entry_error_mm;   ///< Distance from the planned to the actual entry point
  ToleratedValue target_error_mm;  ///< Distance from the target to the nearest point of the insertion
  /// Components of the target error: perpendicular to the trajectory, and along it, positive beyond the
  /// target.
  double lateral_mm = kNoValue, along_mm = kNoValue;
  /// Angle between the trajectory and the line fitted to the path from the entry to the deepest point (total
  /// least squares, path segments weighted by their length), 0 ... 180. Unknown for paths below 1 mm.
  ToleratedValue angle_deg;
  double line_rms_mm = kNoValue;  ///< RMS distance of the path from that line
  /// Distance from the actual entry to the deepest point, along the trajectory
  double depth_mm = kNoValue;
  ToleratedValue depth_error_mm;  ///< depth_mm minus the trajectory's length: positive is too deep
  /// Angle between the trajectory and the tool's shaft (the spindle of a burr, otherwise the longest capsule)
  /// at the deepest point. Known only for tools with a shaft and devices that report an orientation.
  double shaft_deg = kNoValue;

  bool is_within_limit() const {
    return entry_error_mm.is_within_limit() && target_error_mm.is_within_limit() &&
           angle_deg.is_within_limit() && depth_error_mm.is_within_limit();
  }
};

/// Planned and removed volume.
struct VolumeResult {
  double planned_mm3 = 0, removed_mm3 = 0;
  double remaining_mm3() const { return planned_mm3 - removed_mm3; }
};
/// Removal of one structure: planned volume, volume removed within the plan, and volume removed outside it.
struct StructureVolume {
  LabelId label = 0;
  VolumeResult in_plan;
  double outside_mm3 = 0;
};

/// Clearance of the tool's head to a structure: from the head's surface to the structure's surface as
/// prepared, before any removal; negative inside.
struct StructureClearance {
  LabelId label = 0;
  double nearest_mm = kNoValue;
  RunPoint nearest;
  std::optional<double> requested_mm;  ///< Minimum clearance required by the plan
  double below_s = 0;                  ///< Duration below that clearance
  /// Minimum in each interval of PlanComparison::times_s; NaN if no tick had a valid position.
  std::vector<float> over_time_mm;

  bool is_within_limit() const { return !requested_mm || nearest_mm >= *requested_mm; }
};
/// Interval in which a required clearance was violated.
struct ClearanceViolation {
  LabelId label = 0;
  double requested_mm = 0, nearest_mm = 0;
  RunPoint begin, nearest;
  std::uint64_t last_tick = 0;
  double end_s = 0;
};

/// Result of compare_recording().
struct PlanComparison {
  std::uint64_t ticks = 0;
  std::uint64_t invalid_ticks = 0;             ///< Number of ticks with a non-finite tip position
  double time_s = 0;                           ///< Duration from the first to the last tick
  bool cut_short = false;                      ///< Whether the recording is truncated
  double missing_s = 0;                        ///< Total duration of gaps in the tick numbers
  std::vector<TrajectoryResult> trajectories;  ///< In the order of the plan
  std::vector<VolumeResult> regions;           ///< In the order of the plan
  std::vector<StructureVolume> volumes;        ///< Structures that are in the plan or were cut
  std::vector<StructureClearance> approaches;  ///< Every structure, in the order of structure_distances()
  /// Start times of intervals of equal numbers of ticks, at most kMaxPlanTimes
  std::vector<double> times_s;
  std::vector<ClearanceViolation> violations;  ///< In the order of their start, at most kMaxViolations
  std::uint64_t omitted_violations = 0;        ///< Number of violations beyond these
  std::vector<Point<Patient>> path;  ///< Path of the tip, decimated to at most kMaxPathPoints points

  /// Whether every tolerance of the plan was met, the recording is not truncated, and no tick is missing (a
  /// tolerance may have been violated in a missing tick). Volumes have no tolerance.
  bool is_within_limit() const;
};
/// Capacities of PlanComparison: intervals, breaches, points of the path.
inline constexpr std::size_t kMaxPlanTimes = 400, kMaxViolations = 1000, kMaxPathPoints = 4000;

/// Compares a recording with a plan in one pass. Memory does not depend on the recording's length, except for
/// the removed tissue.
/// @param model      model at the start of the recording
/// @param distances  result of structure_distances(model)
/// @param device     index of the device that holds the tool
/// Errors: those of reading it; kBadInput if it has no tick or no such device, or if its time decreases.
Result<PlanComparison> compare_recording(const PlanInScene& plan, const Model& model,
                                         const std::vector<StructureDistance>& distances,
                                         const RecordingSource& recording, std::size_t device = 0,
                                         const Progress& progress = {});

}  // namespace palpate
