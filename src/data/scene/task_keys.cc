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

TableSpec task_top_table() {
  return {"top level",
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
            .meaning = "Parameters of `data_set` that `palpate task draw` draws with its seed."}}};
}

TableSpec task_region_table() {
  return {"[[region]]",
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
           {.name = "radius", .type = kNumber, .unit = "mm", .min = 0.5, .max = 200, .meaning = "See above."},
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
                       "a vector in LPS. Together with `plane_point`."}}};
}

TableSpec task_step_table() {
  return {
      "[[step]]",
      "A step is done once its region was touched, visited, covered or removed as required.",
      {{.name = "name", .type = kText, .meaning = "Required."},
       {.name = "region",
        .type = kText,
        .meaning = "Name of a region; for `remove` of a region of the plan. Required."},
       {.name = "kind",
        .type = kChoice,
        .default_text = "\"touch\"",
        .choices = {"touch", "visit", "cover", "remove"},
        .meaning = "`touch`: touched with a force in `force` for `seconds` without a break. `visit`: the tip "
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
        .meaning = "For a touch: `true`: the touched place must be in view of the scope."}}};
}

TableSpec task_force_table() {
  return {"[[force]]",
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
                       "integrates the excess."}}};
}

TableSpec task_protection_table() {
  return {"[[protected]]",
          "Structures that must not be touched.",
          {structures_key("Required."),
           {.name = "limit",
            .type = kNumber,
            .default_text = "0.2",
            .unit = "N",
            .max = 100,
            .meaning = "A normal force above it is a touch: an event, counted in `protected_time`."}}};
}

TableSpec task_metric_table() {
  return {"[[metric]]",
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
            .meaning = "Source of the bounds. Default: the score says \"not validated\"."}}};
}

TableSpec task_answer_table() {
  return {"[answer]",
          "The trainee answers where a structure is by resting the tip there: `answer_error` is "
          "measured from the last such place.",
          {structures_key("Structures to find, in one piece. Required."),
           {.name = "seconds",
            .type = kNumber,
            .default_text = "1",
            .unit = "s",
            .min = 0.1,
            .max = 60,
            .meaning = "Duration of contact within 1.5 mm that counts as resting."}}};
}

TableSpec task_scope_table() {
  return {"[scope]",
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
            .meaning = "Distance from its tip back along the shaft to the camera."}}};
}

TableSpec task_microscope_table() {
  return {"[microscope]",
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
            .meaning = "Angle by which it may be tilted in any direction."}}};
}

TableSpec task_drawn_table() {
  return {"[[drawn]]",
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
           {.name = "words", .type = kNames, .meaning = "Values to draw from in place of a number."}}};
}

TaskKeys declared_task_keys() {
  return {.top = task_top_table(),
          .region = task_region_table(),
          .step = task_step_table(),
          .force = task_force_table(),
          .protection = task_protection_table(),
          .metric = task_metric_table(),
          .answer = task_answer_table(),
          .scope = task_scope_table(),
          .microscope = task_microscope_table(),
          .drawn = task_drawn_table()};
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

}  // namespace palpate
