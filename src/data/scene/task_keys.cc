#include "scene/task_keys.h"

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
           "What the task is, and when it is over.",
           {{.name = "title", .type = kText, .meaning = "Has to be there."},
            {.name = "briefing", .type = kText, .meaning = "What the trainee is told before."},
            {.name = "data_set",
             .type = kText,
             .meaning =
                 "The data set that it is made for, with parameters if it needs any; without it, any scene "
                 "with these structures."},
            {.name = "ordered",
             .type = kFlag,
             .default_text = "false",
             .meaning = "`true`: a step counts only after those before it."},
            {.name = "quiz",
             .type = kFlag,
             .default_text = "false",
             .meaning =
                 "`true`: while it is done the page names no structure, and draws none that is to be found."},
            {.name = "end",
             .type = kChoice,
             .default_text = "\"steps\"",
             .choices = {"steps", "recording"},
             .meaning =
                 "What ends it: the last step that is done, or the recording. Nothing after it counts."},
            {.name = "time_limit",
             .type = kNumber,
             .unit = "s",
             .min = 1,
             .max = 36000,
             .meaning = "It is over then, whatever is done."},
            {.name = "in_a_row",
             .type = kWhole,
             .default_text = "3",
             .min = 1,
             .max = 100,
             .meaning =
                 "How many runs one after the other have to have every counted metric in its band for a "
                 "pass."},
            {.name = "region", .type = kTables, .meaning = "Parts of the patient, which steps name."},
            {.name = "step", .type = kTables, .meaning = "What is to be done."},
            {.name = "force", .type = kTables, .meaning = "What force structures are to be touched with."},
            {.name = "protected", .type = kTables, .meaning = "What is not to be touched."},
            {.name = "metric", .type = kTables, .meaning = "What is measured: at least one."},
            {.name = "answer", .type = kTable, .meaning = "What the trainee has to find."},
            {.name = "scope", .type = kTable, .meaning = "The second device holds a scope."},
            {.name = "plan",
             .type = kText,
             .meaning =
                 "A plan (docs/guide/rehearsal.md), whose regions are to be taken off: a file beside the "
                 "task, or "
                 "the name of one that palpate brings along. The scene's tool is a burr or shaver then."},
            {.name = "drawn",
             .type = kTables,
             .meaning = "Parameters of `data_set` that `palpate task draw` draws by its seed."}}},
      .region = {"[[region]]",
                 "The surface of structures, or what `radius`, `half` and `plane` leave of it; without "
                 "structures a ball.",
                 {{.name = "name", .type = kText, .meaning = "Unique. Has to be there."},
                  structures_key("Whose surface."),
                  {.name = "point",
                   .type = kPoint,
                   .unit = "mm",
                   .min = -kFar_mm,
                   .max = kFar_mm,
                   .meaning = "LPS: what lies within `radius` of it."},
                  {.name = "landmark",
                   .type = kChoice,
                   .choices = direction_names(),
                   .meaning = "What lies within `radius` of the structures' most superior, ... place. Not "
                              "beside `point`."},
                  {.name = "radius",
                   .type = kNumber,
                   .unit = "mm",
                   .min = 0.5,
                   .max = 200,
                   .meaning = "See above."},
                  {.name = "half",
                   .type = kChoice,
                   .choices = direction_names(),
                   .meaning = "What lies on this side of the middle (centroid) of the structures."},
                  {.name = "plane_point",
                   .type = kPoint,
                   .unit = "mm",
                   .min = -kFar_mm,
                   .max = kFar_mm,
                   .meaning = "LPS: a plane goes through it."},
                  {.name = "plane_normal",
                   .type = kDirection,
                   .choices = direction_names(),
                   .meaning = "What lies on the side of the plane to which this points; or in LPS. Beside "
                              "`plane_point`."}}},
      .step =
          {"[[step]]",
           "Done once its region was touched, visited or covered as it says.",
           {{.name = "name", .type = kText, .meaning = "Has to be there."},
            {.name = "region",
             .type = kText,
             .meaning = "Name of a region; of `remove` of one of the plan's. Has to be there."},
            {.name = "kind",
             .type = kChoice,
             .default_text = "\"touch\"",
             .choices = {"touch", "visit", "cover", "remove"},
             .meaning = "`touch`: touched with a force in `force` for `seconds` without a break. `visit`: "
                        "the tip is "
                        "within a ball that long. `cover`: `coverage` of its surface was touched. `remove`: "
                        "`coverage` of what can be taken off of it is gone."},
            {.name = "force",
             .type = kInterval,
             .default_text = "[0.2, inf]",
             .unit = "N",
             .min = 0.01,
             .max = 100,
             .meaning = "Of a touch: the normal force on the region's structures."},
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
             .meaning = "Of a touch: `true`: the scope has to see what is touched."}}},
      .force = {"[[force]]",
                "With what force structures, taken together, are to be touched.",
                {structures_key("Has to be there."),
                 {.name = "band",
                  .type = kInterval,
                  .unit = "N",
                  .max = 100,
                  .meaning = "Normal force that is right; `force_in_band` and `longest_in_band` are of it."},
                 {.name = "limit",
                  .type = kNumber,
                  .unit = "N",
                  .min = 0.05,
                  .max = 100,
                  .meaning = "Normal force that is too much: each tick that passes it is an event, and "
                             "`excess_impulse` is of what lies above."}}},
      .protection = {"[[protected]]",
                     "What is not to be touched.",
                     {structures_key("Has to be there."),
                      {.name = "limit",
                       .type = kNumber,
                       .default_text = "0.2",
                       .unit = "N",
                       .max = 100,
                       .meaning = "A normal force above it is a touch: an event, and `protected_time`."}}},
      .metric =
          {"[[metric]]",
           "What is measured. It counts where it has a bound.",
           {{.name = "name", .type = kChoice, .choices = metric_names(), .meaning = "Has to be there."},
            structures_key("Of `mean_force` and `peak_force`: on which; without it on all."),
            {.name = "at_least", .type = kNumber, .min = -1e9, .max = 1e9, .meaning = "Bound, in its unit."},
            {.name = "at_most", .type = kNumber, .min = -1e9, .max = 1e9, .meaning = "Bound, in its unit."},
            {.name = "basis",
             .type = kText,
             .meaning = "Where the bounds come from. Without it the score says \"not validated\"."}}},
      .answer =
          {"[answer]",
           "The trainee tells where something is by resting on it: `answer_error` is of the last such place.",
           {structures_key("What is to be found, in one piece. Has to be there."),
            {.name = "seconds",
             .type = kNumber,
             .default_text = "1",
             .unit = "s",
             .min = 0.1,
             .max = 60,
             .meaning = "Touched for so long within 1.5 mm is resting."}}},
      .scope = {"[scope]",
                "How the second device's scope is made (docs/reference/metrics.md). The page's view "
                "stands so when the task begins.",
                {{.name = "optics",
                  .type = kNumber,
                  .default_text = "30",
                  .unit = "degrees",
                  .max = 90,
                  .meaning = "Between its shaft and where it looks."},
                 {.name = "back",
                  .type = kNumber,
                  .default_text = "8",
                  .unit = "mm",
                  .max = 30,
                  .meaning = "From its tip back along the shaft to the camera."}}},
      .drawn = {
          "[[drawn]]",
          "A parameter of the data set that the seed draws evenly; `seed` itself is always told.",
          {{.name = "key", .type = kText, .meaning = "As in docs/reference/phantom.md. Has to be there."},
           {.name = "range",
            .type = kInterval,
            .min = -1e6,
            .max = 1e6,
            .meaning = "Has to be there, or `words`."},
           {.name = "step",
            .type = kNumber,
            .default_text = "0.5",
            .min = 0.001,
            .max = 1e6,
            .meaning = "From value to value, from the range's beginning."},
           {.name = "words", .type = kNames, .meaning = "One of these in place of a number."}}}};
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
                                 &keys.answer, &keys.scope, &keys.drawn})
    text += "\n" + table_markdown(*table);
  return text;
}

const std::array<MetricInfo, kMetricCount>& metric_infos() {
  static constexpr std::array<MetricInfo, kMetricCount> infos{{
      {Metric::kTime, "time", "s", false, false, "from the first tick to the task's end",
       "FAST stations' benchmarks (2026); Tuijthof et al., PMC3023859",
       "told experts from novices on ArthroS (10.1007/s00167-016-4114-1) and not on ArthroSim"},
      {Metric::kIdleTime, "idle_time", "s", false, false,
       "time in which nothing is touched and the tip, low-passed, is slower than 5 mm/s",
       "lack of motion: D'Angelo et al. 2015 (PMC4412306); the bound of 5 mm/s and the one hand are "
       "palpate's own",
       "attendings had fewer idle periods than students at some steps of suturing (15 persons)"},
      {Metric::kPathLength, "path_length", "mm", false, false,
       "way of the tip in the patient after a second-order Butterworth low-pass at 10 Hz",
       "10.1007/s00167-016-4114-1",
       "told experts from novices on ArthroS; two thirds of that simulator's other metrics did not"},
      {Metric::kEconomy, "economy", "1", true, false,
       "straight way from the start over the places where steps were done to the end, over path_length",
       "economy of motion as in MIST-VR and ArthroS", "not validated here"},
      {Metric::kSmoothness, "smoothness", "1", true, false,
       "log dimensionless jerk, -ln(T^3 / v_peak^2 * integral of jerk^2), of the low-passed way at 100 Hz",
       "Hogan and Sternad 2009 (J Mot Behav 41:529); Balasubramanian et al. 2012 (IEEE TBME 59:2126)",
       "falls with the length of a run: compare runs of one task alone. Not validated here"},
      {Metric::kMeanForce, "mean_force", "N", false, true,
       "time mean of the normal force while it is above 0", "Tuijthof et al., PMC3023859",
       "experts differed from novices at the meniscus"},
      {Metric::kPeakForce, "peak_force", "N", false, true, "greatest normal force of any tick",
       "Tuijthof et al., PMC3023859",
       "experts differed from novices at the meniscus; 8.5 N is the limit in theory"},
      {Metric::kForceInBand, "force_in_band", "1", true, false,
       "part of the time of contact in which the force on each [[force]] lay in its band",
       "bands as Tuijthof et al., PMC3023859; the share itself is palpate's own", "not validated here"},
      {Metric::kLongestInBand, "longest_in_band", "s", true, false,
       "longest time without a break in which the force on a [[force]] lay in its band", "palpate's own",
       "not validated here"},
      {Metric::kExcessImpulse, "excess_impulse", "N s", false, false,
       "integral of max(0, force - limit) over every [[force]] with a limit",
       "palpate's own; forces as measures of skill: Horeman et al. 2012 (IEEE Trans Haptics 5:312)",
       "not validated here"},
      {Metric::kCoverage, "coverage", "1", true, false,
       "part of the 1 mm patches of all regions to be covered that were within 0.5 mm of a contact of 0.2 N "
       "or more",
       "palpate's own", "not validated here"},
      {Metric::kProtectedTime, "protected_time", "s", false, false,
       "time in which the force on any [[protected]] was above its limit", "palpate's own",
       "not validated here"},
      {Metric::kStepsDone, "steps_done", "1", true, false, "part of the steps that were done",
       "completion, as task-specific checklists (ASSET, PMC4574927) have it",
       "of a checklist by raters: ASSET; of this "
       "count: not validated here"},
      {Metric::kAnswerError, "answer_error", "mm", false, false,
       "from the middle of what is to be found to the line through the answered place along the surface's "
       "normal",
       "palpate's own", "not validated here"},
      {Metric::kUnseenTime, "unseen_time", "s", false, false,
       "time of contact of the first device while what it touches first was not seen by the second one's "
       "scope",
       "palpate's own; keeping the instrument in view: ASSET's field of view (PMC4574927)",
       "of the domain as raters see it: ASSET; of this time: not validated here"},
      {Metric::kRemovedInPlan, "removed_in_plan", "mm3", true, false,
       "what was taken off of the plan's regions", "palpate's own", "not validated here"},
      {Metric::kRemovedOutside, "removed_outside", "mm3", false, false,
       "what was taken off outside of the plan's regions", "palpate's own", "not validated here"},
      {Metric::kProtectedRemoved, "protected_removed", "mm3", false, false,
       "what was taken off of every [[protected]] structure, in the plan or not", "palpate's own",
       "not validated here"},
      {Metric::kDepthPastPlan, "depth_past_plan", "mm", false, false,
       "greatest distance of what was taken off from the nearest of the plan's shapes, where it lies outside "
       "of all",
       "palpate's own", "not validated here"},
  }};
  return infos;
}

std::string metric_table() {
  std::string text =
      "| metric | unit | better | what it is | source | validity |\n|---|---|---|---|---|---|\n";
  for (const MetricInfo& info : metric_infos()) {
    text += "| `" + std::string(info.name) + "` | " + std::string(info.unit) + " | " +
            (info.more_is_better ? "more" : "less") + " | " + std::string(info.formula) + " | " +
            std::string(info.source) + " | " + std::string(info.validity) + " |\n";
  }
  return text;
}

}  // namespace palpate
