#include "scene/task_keys.h"

#include <algorithm>

#include "palpate/scene/task_file.h"

namespace palpate {
namespace {

using enum KeyType;

std::vector<std::string_view> metric_names() {
  std::vector<std::string_view> names;
  for (const MetricInfo& info : metric_infos()) names.push_back(info.name);
  return names;
}

constexpr double kFar_mm = 100000;

TaskKeys declared_task_keys() {
  return {
      .top =
          {"top level",
           "Title and end of the task.",
           {{.name = "title", .type = kText, .meaning = "Required."},
            {.name = "briefing", .type = kText, .meaning = "Briefing of the trainee."},
            {.name = "data_set",
             .type = kText,
             .meaning = "The data set that it is made for, with any parameters. Default: any scene with "
                        "these structures."},
            {.name = "ordered",
             .type = kFlag,
             .default_text = "false",
             .meaning = "`true`: a step counts only after the steps before it."},
            {.name = "quiz",
             .type = kFlag,
             .default_text = "false",
             .meaning = "`true`: during the task the page shows no names of structures and does not draw the "
                        "structures to find."},
            {.name = "end",
             .type = kChoice,
             .default_text = "\"steps\"",
             .choices = {"steps", "recording"},
             .meaning = "End of the task: completion of all steps, or the end of the recording. Nothing "
                        "after it counts."},
            {.name = "time_limit",
             .type = kNumber,
             .unit = "s",
             .min = 1,
             .max = 36000,
             .meaning = "Time limit of the task."},
            {.name = "in_a_row",
             .type = kInteger,
             .default_text = "3",
             .min = 1,
             .max = 100,
             .meaning = "Number of consecutive runs with every counted metric in its band that are required "
                        "for a pass."},
            {.name = "region", .type = kTables, .meaning = "Parts of the patient that steps refer to."},
            {.name = "step", .type = kTables, .meaning = "Steps of the task."},
            {.name = "force", .type = kTables, .meaning = "Force with which structures are to be touched."},
            {.name = "protected", .type = kTables, .meaning = "Structures that must not be touched."},
            {.name = "metric", .type = kTables, .meaning = "Metrics: at least one."},
            {.name = "answer", .type = kTable, .meaning = "Structure that the trainee must find."},
            {.name = "scope", .type = kTable, .meaning = "The second device holds a scope."},
            {.name = "microscope", .type = kTable, .meaning = "View by which hidden cutting is measured."},
            {.name = "plan",
             .type = kText,
             .meaning = "A plan (docs/guide/rehearsal.md), whose regions are to be removed: a file next to "
                        "the task, or the name of a plan included with palpate. The tool of the scene must "
                        "be a burr or shaver."},
            {.name = "drawn",
             .type = kTables,
             .meaning = "Parameters of `data_set` that `palpate task draw` draws with its seed."}}},
      .region = {"[[region]]",
                 "The surface of structures, or the part of it selected by `radius`, `half` and `plane`; "
                 "without structures a ball.",
                 {{.name = "name", .type = kText, .meaning = "Unique. Required."},
                  structures_key("Structures of the surface."),
                  {.name = "point",
                   .type = kPoint,
                   .unit = "mm",
                   .min = -kFar_mm,
                   .max = kFar_mm,
                   .meaning = "LPS: selects the surface within `radius` of it."},
                  {.name = "landmark",
                   .type = kChoice,
                   .choices = direction_names(),
                   .meaning = "Selects the surface within `radius` of the structures' most superior, ... "
                              "place. Not together with `point`."},
                  {.name = "radius",
                   .type = kNumber,
                   .unit = "mm",
                   .min = 0.5,
                   .max = 200,
                   .meaning = "See above."},
                  {.name = "half",
                   .type = kChoice,
                   .choices = direction_names(),
                   .meaning = "Selects the surface on this side of the centroid of the structures."},
                  {.name = "plane_point",
                   .type = kPoint,
                   .unit = "mm",
                   .min = -kFar_mm,
                   .max = kFar_mm,
                   .meaning = "LPS: a point on the plane."},
                  {.name = "plane_normal",
                   .type = kDirection,
                   .choices = direction_names(),
                   .meaning = "Selects the surface on the side of the plane to which this normal points; or "
                              "a vector in LPS. Together with `plane_point`."}}},
      .step =
          {"[[step]]",
           "A step is done once its region was touched, visited, covered or removed as required.",
           {{.name = "name", .type = kText, .meaning = "Required."},
            {.name = "region",
             .type = kText,
             .meaning = "Name of a region; for `remove` of a region of the plan. Required."},
            {.name = "kind",
             .type = kChoice,
             .default_text = "\"touch\"",
             .choices = {"touch", "visit", "cover", "remove"},
             .meaning =
                 "`touch`: touched with a force in `force` for `seconds` without a break. `visit`: the tip "
                 "stays within a ball for `seconds`. `cover`: the fraction `coverage` of its surface was "
                 "touched. `remove`: the fraction `coverage` of its removable volume was removed."},
            {.name = "force",
             .type = kInterval,
             .default_text = "[0.2, inf]",
             .unit = "N",
             .min = 0.01,
             .max = 100,
             .meaning = "For a touch: normal force on the structures of the region."},
            {.name = "seconds",
             .type = kNumber,
             .default_text = "0.1",
             .unit = "s",
             .max = 600,
             .meaning = "See above."},
            {.name = "coverage", .type = kNumber, .default_text = "0.5", .max = 1, .meaning = "See above."},
            {.name = "seen",
             .type = kFlag,
             .default_text = "false",
             .meaning = "For a touch: `true`: the touched place must be in view of the scope."}}},
      .force = {"[[force]]",
                "Total force with which structures are to be touched.",
                {structures_key("Required."),
                 {.name = "band",
                  .type = kInterval,
                  .unit = "N",
                  .max = 100,
                  .meaning = "Correct normal force; used by `force_in_band` and `longest_in_band`."},
                 {.name = "limit",
                  .type = kNumber,
                  .unit = "N",
                  .min = 0.05,
                  .max = 100,
                  .meaning = "Maximum normal force: each tick above it is an event, and `excess_impulse` "
                             "integrates the excess."}}},
      .protection = {"[[protected]]",
                     "Structures that must not be touched.",
                     {structures_key("Required."),
                      {.name = "limit",
                       .type = kNumber,
                       .default_text = "0.2",
                       .unit = "N",
                       .max = 100,
                       .meaning =
                           "A normal force above it is a touch: an event, counted in `protected_time`."}}},
      .metric = {"[[metric]]",
                 "A metric. It counts if it has a bound.",
                 {{.name = "name", .type = kChoice, .choices = metric_names(), .meaning = "Required."},
                  structures_key("For `mean_force` and `peak_force`: structures measured; default: all. For "
                                 "`bone_left`, `burr_distance` and `force_near`: required."),
                  {.name = "within",
                   .type = kNumber,
                   .default_text = "2",
                   .unit = "mm",
                   .min = 0,
                   .max = 50,
                   .meaning = "For `force_near`: distance from the structures."},
                  {.name = "at_least",
                   .type = kNumber,
                   .min = -1e9,
                   .max = 1e9,
                   .meaning = "Bound, in the unit of the metric."},
                  {.name = "at_most",
                   .type = kNumber,
                   .min = -1e9,
                   .max = 1e9,
                   .meaning = "Bound, in the unit of the metric."},
                  {.name = "basis",
                   .type = kText,
                   .meaning = "Source of the bounds. Default: the score says \"not validated\"."}}},
      .answer = {"[answer]",
                 "The trainee answers where a structure is by resting the tip there: `answer_error` is "
                 "measured from the last such place.",
                 {structures_key("Structures to find, in one piece. Required."),
                  {.name = "seconds",
                   .type = kNumber,
                   .default_text = "1",
                   .unit = "s",
                   .min = 0.1,
                   .max = 60,
                   .meaning = "Duration of contact within 1.5 mm that counts as resting."}}},
      .scope = {"[scope]",
                "Geometry of the second device's scope (docs/reference/metrics.md). Initial view of the page "
                "in the task.",
                {{.name = "optics",
                  .type = kNumber,
                  .default_text = "30",
                  .unit = "degrees",
                  .max = 90,
                  .meaning = "Angle between its shaft and its direction of view."},
                 {.name = "back",
                  .type = kNumber,
                  .default_text = "8",
                  .unit = "mm",
                  .max = 30,
                  .meaning = "Distance from its tip back along the shaft to the camera."}}},
      .microscope = {"[microscope]",
                     "Operating microscope (docs/reference/metrics.md).",
                     {{.name = "from",
                       .type = kDirection,
                       .default_text = "\"anterior\"",
                       .min = -1e6,
                       .max = 1e6,
                       .choices = direction_names(),
                       .meaning = "Side of the patient on which it is; or a direction in LPS."},
                      {.name = "tilt",
                       .type = kNumber,
                       .default_text = "25",
                       .unit = "degrees",
                       .max = 60,
                       .meaning = "Angle by which it may be tilted in any direction."}}},
      .drawn = {
          "[[drawn]]",
          "A parameter of the data set, drawn uniformly with the seed; `seed` itself is always included.",
          {{.name = "key",
            .type = kText,
            .meaning = "Parameter name, as in docs/reference/phantom.md. Required."},
           {.name = "range",
            .type = kInterval,
            .min = -1e6,
            .max = 1e6,
            .meaning = "Required, unless `words` is given."},
           {.name = "step",
            .type = kNumber,
            .default_text = "0.5",
            .min = 0.001,
            .max = 1e6,
            .meaning = "Difference between values, from the start of the range."},
           {.name = "words", .type = kNames, .meaning = "Values to draw from in place of a number."}}}};
}

}  // namespace

const TaskKeys& task_key_tables() {
  static const TaskKeys keys = declared_task_keys();
  return keys;
}

std::string task_keys() {
  const TaskKeys& keys = task_key_tables();
  std::string text = table_markdown(keys.top);
  for (const TableSpec* table : {&keys.region, &keys.step, &keys.force, &keys.protection, &keys.metric,
                                 &keys.answer, &keys.scope, &keys.microscope, &keys.drawn})
    text += "\n" + table_markdown(*table);
  return text;
}

const std::array<MetricInfo, kMetricCount>& metric_infos() {
  static constexpr std::array<MetricInfo, kMetricCount> infos{{
      {Metric::kTime, "time", "Time", "s", false, false, "from the first tick to the task's end",
       "FAST stations' benchmarks (2026); Tuijthof et al., PMC3023859",
       "distinguished experts from novices on ArthroS (10.1007/s00167-016-4114-1) but not on ArthroSim"},
      {Metric::kIdleTime, "idle_time", "Idle time", "s", false, false,
       "time in which nothing is touched and the tip, low-passed, is slower than 5 mm/s",
       "lack of motion: D'Angelo et al. 2015 (PMC4412306); the bound of 5 mm/s and the one hand are "
       "palpate's own",
       "attendings had fewer idle periods than students at some steps of suturing (15 persons)"},
      {Metric::kPathLength, "path_length", "Path length", "mm", false, false,
       "path length of the tip in the patient after a second-order Butterworth low-pass at 10 Hz",
       "10.1007/s00167-016-4114-1",
       "distinguished experts from novices on ArthroS; two thirds of that simulator's other metrics did not"},
      {Metric::kEconomy, "economy", "Economy of motion", "1", true, false,
       "length of the straight path from start to end through the places where steps were done, divided by "
       "path_length",
       "economy of motion as in MIST-VR and ArthroS", "not validated here"},
      {Metric::kSmoothness, "smoothness", "Smoothness (log dimensionless jerk)", "1", true, false,
       "log dimensionless jerk, -ln(T^3 / v_peak^2 * integral of jerk^2), of the low-passed path at 100 Hz",
       "Hogan and Sternad 2009 (J Mot Behav 41:529); Balasubramanian et al. 2012 (IEEE TBME 59:2126)",
       "falls with the length of a run: compare only runs of the same task. Not validated here"},
      {Metric::kMeanForce, "mean_force", "Mean force", "N", false, true,
       "time mean of the normal force sent while it is above 0", "Tuijthof et al., PMC3023859",
       "experts differed from novices at the meniscus"},
      {Metric::kPeakForce, "peak_force", "Peak force", "N", false, true,
       "greatest normal force sent in any tick", "Tuijthof et al., PMC3023859",
       "experts differed from novices at the meniscus; 8.5 N is the theoretical limit"},
      {Metric::kForceInBand, "force_in_band", "Contact time with force in band", "1", true, false,
       "fraction of the contact time in which the force sent on each [[force]] was in its band",
       "bands as in Tuijthof et al., PMC3023859; the fraction itself is palpate's own", "not validated here"},
      {Metric::kLongestInBand, "longest_in_band", "Longest time in band", "s", true, false,
       "longest uninterrupted time in which the force sent on a [[force]] was in its band", "palpate's own",
       "not validated here"},
      {Metric::kExcessImpulse, "excess_impulse", "Excess impulse", "N s", false, false,
       "integral of max(0, force sent - limit) over every [[force]] with a limit",
       "palpate's own; forces as measures of skill: Horeman et al. 2012 (IEEE Trans Haptics 5:312)",
       "not validated here"},
      {Metric::kCoverage, "coverage", "Surface coverage", "1", true, false,
       "fraction of the 1 mm patches of all regions to be covered that were within 0.5 mm of the path of a "
       "touch of 0.2 N or more that moved by at least 2 mm",
       "palpate's own", "not validated here"},
      {Metric::kProtectedTime, "protected_time", "Contact time on protected structures", "s", false, false,
       "time in which the force sent on any [[protected]] was above its limit", "palpate's own",
       "not validated here"},
      {Metric::kStepsDone, "steps_done", "Steps completed", "1", true, false,
       "fraction of the steps that were done",
       "completion, as in task-specific checklists (ASSET, PMC4574927)",
       "checklist by raters: ASSET; this count: not validated here"},
      {Metric::kAnswerError, "answer_error", "Answer error", "mm", false, false,
       "distance from the centre of the structure to be found to the line through the answered place along "
       "the surface's normal",
       "palpate's own", "not validated here"},
      {Metric::kUnseenTime, "unseen_time", "Contact time out of the scope's view", "s", false, false,
       "time of contact of the first device outside the view of the second device's scope",
       "palpate's own; keeping the instrument in view: ASSET's field of view (PMC4574927)",
       "domain as rated: ASSET; this time: not validated here"},
      {Metric::kRemovedInPlan, "removed_in_plan", "Volume removed inside the plan", "mm3", true, false,
       "volume removed inside the plan's regions", "palpate's own", "not validated here"},
      {Metric::kRemovedOutside, "removed_outside", "Volume removed outside the plan", "mm3", false, false,
       "volume removed outside the plan's regions", "palpate's own", "not validated here"},
      {Metric::kProtectedRemoved, "protected_removed", "Volume removed from protected structures", "mm3",
       false, false, "volume removed from every [[protected]] structure, inside the plan or not",
       "palpate's own", "not validated here"},
      {Metric::kDepthPastPlan, "depth_past_plan", "Maximum depth beyond the plan", "mm", false, false,
       "greatest distance of removed volume from the nearest of the plan's shapes, if it lies outside all of "
       "them",
       "palpate's own", "not validated here"},
      {Metric::kBoneLeft, "bone_left", "Bone left", "mm", true, true,
       "smallest distance of removed volume from the structures' surface before any removal; negative: the "
       "depth to which they were cut",
       "palpate's own; that the sinus is skeletonised is an item of the Melbourne Mastoidectomy Scale",
       "items as rated: ten surgical trainees struggled with those on the sinus; this distance: not "
       "validated "
       "here",
       "over", true},
      {Metric::kBurrDistance, "burr_distance", "Smallest distance of the running burr", "mm", true, true,
       "smallest distance of the running burr's head from the structures' surface before any removal; "
       "negative: inside",
       "Sewell et al. 2008 (10.3109/10929080801957712): distances to structures in a mastoidectomy",
       "experts used more caution near structures than residents (7 and 7 persons, "
       "10.1097/mao.0000000000001398); this distance: not validated here",
       "to", true},
      {Metric::kForceNear, "force_near", "Peak force of the running burr", "N", false, true,
       "greatest normal force sent while the running burr's head is within `within` of the structures",
       "Sewell et al. 2008 (10.3109/10929080801957712): forces by the distance to structures",
       "experts used higher forces than residents, and more caution near structures (7 and 7 persons, "
       "10.1097/mao.0000000000001398); this force: not validated here",
       "near", true},
      {Metric::kHiddenTime, "hidden_time", "Cutting time out of the microscope's view", "s", false, false,
       "time in which the running burr touches something and no line of sight from it to the microscope, "
       "within its tilt, is free of tissue that is left",
       "Sewell et al. 2008 (10.3109/10929080801957712): bone removed without being seen",
       "not validated here"},
  }};
  return infos;
}

std::string readable_metric_name(std::string_view stored) {
  constexpr std::string_view kOf = " of ";
  const std::size_t of = stored.find(kOf);
  const auto info = std::ranges::find(metric_infos(), stored.substr(0, of), &MetricInfo::name);
  if (info == metric_infos().end()) return std::string(stored);
  std::string text(info->title);
  if (of == std::string_view::npos) return text;
  std::string structures(stored.substr(of + kOf.size()));
  std::ranges::replace(structures, '_', ' ');
  return text + " " + std::string(info->relation) + " " + structures;
}

std::string metric_table() {
  std::string text =
      "| metric | shown as | unit | better | what it is | source | validity "
      "|\n|---|---|---|---|---|---|---|\n";
  for (const MetricInfo& info : metric_infos()) {
    text += "| `" + std::string(info.name) + "` | " + std::string(info.title) + " | " +
            std::string(info.unit) + " | " + (info.more_is_better ? "more" : "less") + " | " +
            std::string(info.formula) + " | " + std::string(info.source) + " | " +
            std::string(info.validity) + " |\n";
  }
  return text;
}

}  // namespace palpate
