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
#include "palpate/haptics/scope.h"
#include "palpate/scene/plan_file.h"
#include "palpate/scene/scene.h"

/// The task file, TOML: what a trainee is to do in a scene, and what of it counts. Read as scenes and scripts
/// are: unknown keys, wrong types and values out of range are errors with their line.
/// docs/reference/task-keys.md has every key. Structures are named and looked up later, where a scene is at
/// hand (palpate/tasks/task.h).
namespace palpate {

inline constexpr std::size_t kMaxTaskParts = 200;  ///< of steps, regions, metrics, ... each

/// What a run is measured by. Formulas: palpate/tasks/evaluator.h.
enum class Metric : std::uint8_t {
  kTime,
  kIdleTime,
  kPathLength,
  kEconomy,
  kSmoothness,
  kMeanForce,
  kPeakForce,
  kForceInBand,
  kLongestInBand,
  kExcessImpulse,
  kCoverage,
  kProtectedTime,
  kStepsDone,
  kAnswerError,
  kUnseenTime,
  kRemovedInPlan,
  kRemovedOutside,
  kProtectedRemoved,
  kDepthPastPlan,
};
struct MetricInfo {
  Metric metric;
  std::string_view name, unit;
  bool more_is_better;
  bool of_structures;         ///< [[metric]] may name structures
  std::string_view formula;   ///< in words
  std::string_view source;    ///< who published it
  std::string_view validity;  ///< what is known of whether it tells experts from beginners
};
inline constexpr std::size_t kMetricCount = 19;
const std::array<MetricInfo, kMetricCount>& metric_infos();  ///< in the order of Metric
inline const MetricInfo& info_of(Metric metric) {
  return metric_infos()[static_cast<std::size_t>(metric)];
}

/// A part of the patient: of some structures' surfaces, or a ball.
struct TaskRegion {
  std::string name;
  std::vector<LabelReference> structures;  ///< empty: the ball about `point` itself
  std::optional<Point<Patient>> point;     ///< with radius_mm
  std::optional<Vector<Patient>>
      landmark;  ///< of the structures, the place farthest this way; with radius_mm
  std::optional<double> radius_mm;
  std::optional<Vector<Patient>> half;  ///< what lies on this side of the structures' own middle
  std::optional<Point<Patient>> plane_point;
  std::optional<Vector<Patient>> plane_normal;  ///< what lies on its side of a plane through plane_point
  int line = 0;
};

enum class StepKind : std::uint8_t {
  kTouch,   ///< the region is touched with a force for a time
  kVisit,   ///< the tip is in the region for a time
  kCover,   ///< a part of the region's surface was touched
  kRemove,  ///< a part of a region of the plan was taken off
};
struct TaskStep {
  std::string name;
  std::size_t region = 0;  ///< place in TaskFile::regions; of kRemove in TaskFile::plan's
  StepKind kind = StepKind::kTouch;
  std::array<double, 2> force_N{0.2, std::numeric_limits<double>::infinity()};
  double seconds = 0.1;   ///< without a break
  double coverage = 0.5;  ///< 0 ... 1
  bool seen = false;      ///< of a touch: what of it the scope does not see does not count
  int line = 0;
};

/// What force some structures bear, taken together.
struct TaskForce {
  std::vector<LabelReference> structures;
  std::optional<std::array<double, 2>> band_N;
  std::optional<double> limit_N;
  int line = 0;
};
struct TaskProtected {
  std::vector<LabelReference> structures;
  double limit_N = 0.2;  ///< a touch above it is one
  int line = 0;
};
struct TaskMetric {
  Metric metric = Metric::kTime;
  std::vector<LabelReference> structures;   ///< empty: see MetricInfo::formula
  std::optional<double> at_least, at_most;  ///< neither: it is shown and does not count
  std::string basis;                        ///< where the band comes from
  int line = 0;

  bool counts() const { return at_least || at_most; }
};
/// A place that the trainee tells by resting on it.
struct TaskAnswer {
  std::vector<LabelReference> structures;
  double seconds = 1;
  int line = 0;
};
/// The second device holds a scope.
struct TaskScope {
  ScopeOptics optics;
  int line = 0;
};
/// A key of the data set that the seed draws.
struct TaskDraw {
  std::string key;
  std::array<double, 2> range{};
  double step = 0.5;
  std::vector<std::string> words;  ///< one of these; none: a number of the range
};

enum class TaskEnd : std::uint8_t {
  kSteps,      ///< when every step is done
  kRecording,  ///< when the recording ends
};

struct TaskFile {
  std::string title, briefing;
  std::string data_set;  ///< that it is made for; empty: any scene that has its structures
  bool ordered = false;  ///< steps count in their order only
  bool quiz = false;     ///< structures have no names while it is done
  TaskEnd end = TaskEnd::kSteps;
  std::optional<double> time_limit_s;
  int in_a_row = 3;  ///< runs with every counted metric in its band that make a pass
  std::vector<TaskRegion> regions;
  std::vector<TaskStep> steps;
  std::vector<TaskForce> forces;
  std::vector<TaskProtected> protections;
  std::vector<TaskMetric> metrics;
  std::optional<TaskAnswer> answer;
  std::optional<TaskScope> scope;
  std::optional<PlanFile> plan;  ///< whose regions are to be taken off
  std::vector<TaskDraw> draws;
  std::string source;
  std::uint64_t text_hash = 0;  ///< of its text and the plan's

  std::string where(int line) const { return source + ":" + std::to_string(line); }
};

/// @param source  names the text in errors ("task.toml:12: ...")
/// @param beside  the folder from which a plan is read that is a file; none: of embedded_plans() alone
Result<TaskFile> parse_task(std::string_view text, const std::string& source,
                            const std::optional<std::filesystem::path>& beside = {});
/// A task of embedded_tasks() by its name, else the file.
Result<TaskFile> load_task(const std::string& name_or_file);

/// The files of data/tasks/, compiled in: "meniscus-probing.toml", ...
const std::vector<EmbeddedFile>& embedded_tasks();

/// The data set with what the seed draws: "palpation-block:seed=5,diameter=8.5"; of a task with a plan as it
/// is, for a plan is one patient's. Empty where the task names none.
std::string drawn_data_set(const TaskFile& task, std::uint64_t seed);

/// Every key of a task file, and every metric, as Markdown tables: those of docs/reference/task-keys.md and
/// docs/reference/metrics.md.
std::string task_keys();
std::string metric_table();

}  // namespace palpate
