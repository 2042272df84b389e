#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/base/embedded_file.h"
#include "palpate/contact/scope.h"
#include "palpate/scene/plan_file.h"
#include "palpate/scene/scene.h"

/// The task file (TOML): what a trainee has to do in a scene, and how the run is graded. The same parsing
/// rules as for scenes and scripts apply: unknown keys, wrong types and values out of range are errors with
/// their line. task_keys() lists every key. Structure names are resolved later against a
/// scene (palpate/tasks/task.h).
namespace palpate {

inline constexpr std::size_t kMaxTaskParts = 200;  ///< Maximum number each of steps, regions, metrics, ...

/// Performance metrics of a run. Formulas: palpate/tasks/evaluator.h.
enum class Metric : std::uint8_t {
  /// Duration from the first tick to the task's end, s.
  kTime,
  /// Time without contact in which the low-pass filtered tip is slower than 5 mm/s, s.
  kIdleTime,
  /// Length of the low-pass filtered path of the tip, mm.
  kPathLength,
  /// Straight distances from the start over the places of completed steps to the end, divided by the path
  /// length.
  kEconomy,
  /// Log dimensionless jerk.
  kSmoothness,
  /// Mean normal force while it is above 0, N.
  kMeanForce,
  /// Maximum normal force, N.
  kPeakForce,
  /// Fraction of the contact time with the force of each [[force]] in its band.
  kForceInBand,
  /// Longest uninterrupted time with the force of a [[force]] in its band, s.
  kLongestInBand,
  /// Integral of the force above the limit over all [[force]] with a limit, N s.
  kExcessImpulse,
  /// Fraction of the surface patches of all kCover regions that were touched.
  kCoverage,
  /// Time in which the force on any [[protected]] exceeds its limit, s.
  kProtectedTime,
  /// Fraction of the steps that were completed.
  kStepsDone,
  /// Distance of the structures' centroid from the line through the answered point along the normal, mm.
  kAnswerError,
  /// Contact time in which the outermost contact was invisible to the scope, s.
  kUnseenTime,
  /// Volume removed within the plan's regions, mm3.
  kRemovedInPlan,
  /// Volume removed outside the plan's regions, mm3.
  kRemovedOutside,
  /// Volume removed from [[protected]] structures, mm3.
  kProtectedRemoved,
  /// Maximum distance of removed tissue outside the plan's shapes from the nearest of them, mm.
  kDepthPastPlan,
  /// Smallest distance of removed tissue from the structures, mm; negative: into them.
  kBoneLeft,
  /// Smallest distance of a running burr's head from the structures, mm; negative: into them.
  kBurrDistance,
  /// Greatest normal force while a running burr's head is within TaskMetric::within_mm of the structures, N.
  kForceNear,
  /// Time of contact of a running burr that the task's microscope does not see, s.
  kHiddenTime,
};
/// Description of a metric, for documentation and reports.
struct MetricInfo {
  Metric metric;
  std::string_view name;   ///< Key in task files and in records
  std::string_view title;  ///< Name for readers
  std::string_view unit;
  bool more_is_better;
  bool of_structures;         ///< Whether a [[metric]] may name structures
  std::string_view formula;   ///< Definition in words
  std::string_view source;    ///< Publication
  std::string_view validity;  ///< Evidence that it discriminates experts from novices
  /// Preposition between the title and the structures
  std::string_view relation = "on";
  bool needs_structures = false;  ///< Whether a [[metric]] must name structures
};
inline constexpr std::size_t kMetricCount = 23;
/// Descriptions of all metrics, in the order of Metric
const std::array<MetricInfo, kMetricCount>& metric_infos();
inline const MetricInfo& info_of(Metric metric) {
  return metric_infos()[static_cast<std::size_t>(metric)];
}
/// Name for readers of a metric as records store it (metric_name): "Peak force on medial meniscus" for
/// "peak_force of medial_meniscus". A name of no metric is returned unchanged.
std::string readable_metric_name(std::string_view stored);

/// A region of the patient: part of the surface of some structures, or a ball.
struct TaskRegion {
  std::string name;
  std::vector<LabelReference> structures;  ///< Structures; empty: the region is the ball around `point`
  std::optional<Point<Patient>> point;     ///< Centre of the region; with radius_mm
  /// Direction in which the structures' extreme point is the centre; with radius_mm
  std::optional<Vector<Patient>> landmark;
  std::optional<double> radius_mm;
  std::optional<Vector<Patient>> half;  ///< Restricts the region to this side of the structures' centroid
  std::optional<Point<Patient>> plane_point;
  /// Restricts the region to this side of a plane through plane_point.
  std::optional<Vector<Patient>> plane_normal;
  int line = 0;
};

enum class StepKind : std::uint8_t {
  kTouch,   ///< Touch the region with a force for a duration
  kVisit,   ///< Keep the tip in the region for a duration
  kCover,   ///< Touch a fraction of the region's surface
  kRemove,  ///< Remove a fraction of a region of the plan
};
/// A [[step]] of the task.
struct TaskStep {
  std::string name;
  std::size_t region = 0;  ///< Index into TaskFile::regions; for kRemove into the plan's regions
  StepKind kind = StepKind::kTouch;
  /// Range of the force for kTouch.
  std::array<double, 2> force_N{0.2, std::numeric_limits<double>::infinity()};
  double seconds = 0.1;   ///< Required duration without interruption, for kTouch and kVisit
  double coverage = 0.5;  ///< Required fraction for kCover and kRemove, 0 ... 1
  bool seen = false;      ///< Whether contact of a kTouch counts only while visible through the scope
  int line = 0;
};

/// Limits of the total force on a set of structures.
struct TaskForce {
  std::vector<LabelReference> structures;
  /// Desired range of the force.
  std::optional<std::array<double, 2>> band_N;
  /// Maximum force.
  std::optional<double> limit_N;
  int line = 0;
};
/// Structures that should not be touched.
struct TaskProtected {
  std::vector<LabelReference> structures;
  double limit_N = 0.2;  ///< Force above which a contact is counted
  int line = 0;
};
/// A [[metric]]: a metric with its pass band.
struct TaskMetric {
  Metric metric = Metric::kTime;
  std::vector<LabelReference> structures;   ///< Structures evaluated; empty: as in MetricInfo::formula
  double within_mm = 2;                     ///< Distance from the structures, for kForceNear
  std::optional<double> at_least, at_most;  ///< Bounds of the band; neither: shown but not graded
  std::string basis;                        ///< Origin of the band
  int line = 0;

  bool counts() const { return at_least || at_most; }
};
/// A location that the trainee reports by holding the tip on it.
struct TaskAnswer {
  std::vector<LabelReference> structures;
  /// Duration for which the tip has to rest.
  double seconds = 1;
  int line = 0;
};
/// Declares that the second device holds a scope.
struct TaskScope {
  ScopeOptics optics;
  int line = 0;
};
/// Operating microscope, by which hidden cutting is measured.
struct TaskMicroscope {
  Vector<Patient> from{0, -1, 0};  ///< Unit direction from the patient to the microscope
  double tilt_deg = 25;            ///< Angle by which it may be tilted in any direction
  int line = 0;
};
/// A parameter of the data set that is drawn at random from the seed.
struct TaskDraw {
  std::string key;
  std::array<double, 2> range{};
  double step = 0.5;
  std::vector<std::string> words;  ///< Choices; empty: a number of the range
};

enum class TaskEnd : std::uint8_t {
  kSteps,      ///< When every step is completed
  kRecording,  ///< When the recording ends
};

/// A parsed task file.
struct TaskFile {
  std::string title, briefing;
  std::string data_set;  ///< Data set of the task; empty: any scene with its structures
  bool ordered = false;  ///< Whether steps have to be completed in order
  bool quiz = false;     ///< Whether structure names are hidden during the task
  TaskEnd end = TaskEnd::kSteps;
  std::optional<double> time_limit_s;
  int in_a_row = 3;  ///< Consecutive runs with every graded metric in its band that make a pass
  std::vector<TaskRegion> regions;
  std::vector<TaskStep> steps;
  std::vector<TaskForce> forces;
  std::vector<TaskProtected> protections;
  std::vector<TaskMetric> metrics;
  std::optional<TaskAnswer> answer;
  std::optional<TaskScope> scope;
  std::optional<TaskMicroscope> microscope;
  std::optional<PlanFile> plan;  ///< Plan whose regions are to be removed
  std::vector<TaskDraw> draws;
  std::string source;
  std::uint64_t text_hash = 0;  ///< Hash of its text and of the plan's

  std::string where(int line) const { return source + ":" + std::to_string(line); }
};

/// @param source  name of the text in errors ("task.toml:12: ...")
/// @param beside  base folder of a plan given as a file. Empty: only embedded_plans() are accepted
Result<TaskFile> parse_task(std::string_view text, const std::string& source,
                            const std::optional<std::filesystem::path>& beside = {});
/// Loads an embedded task by name (embedded_tasks()), otherwise a file.
Result<TaskFile> load_task(const std::string& name_or_file);

/// The files of data/tasks/, compiled in: "meniscus-probing.toml", ...
const std::vector<EmbeddedFile>& embedded_tasks();

/// Data set with the parameters drawn from the seed: "palpation-block:seed=5,diameter=8.5". For a task whose
/// plan has positions the data set is unchanged, because such a plan belongs to one patient. Empty if the
/// task names no data set.
std::string drawn_data_set(const TaskFile& task, std::uint64_t seed);

/// Every key of a task file as Markdown tables (key, value, default, unit, range, meaning); generated from
/// the declarations that the parser checks against.
std::string task_keys();
/// Every metric with its formula, source and validity, as a Markdown table.
std::string metric_table();

}  // namespace palpate
