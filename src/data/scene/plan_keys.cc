#include "scene/plan_keys.h"

#include "palpate/scene/plan_file.h"

namespace palpate {
namespace {

using enum KeyType;

KeySpec planned_point(std::string_view name, std::string_view meaning) {
  constexpr double kMaxCoordinate_mm = 100000;
  return {.name = name,
          .type = kPoint,
          .unit = "mm",
          .min = -kMaxCoordinate_mm,
          .max = kMaxCoordinate_mm,
          .meaning = meaning};
}

KeySpec allowed_mm(std::string_view name, std::string_view meaning) {
  return {.name = name, .type = kNumber, .unit = "mm", .min = 0.01, .max = 100, .meaning = meaning};
}

PlanKeys declared_plan_keys() {
  return {.top = {"top level",
                  "Title of the plan. At least one of its tables is required.",
                  {{.name = "title", .type = kText, .meaning = "Required."},
                   {.name = "trajectory", .type = kTables, .meaning = "Straight paths into the patient."},
                   {.name = "region", .type = kTables, .meaning = "Volumes to remove."},
                   {.name = "keep_away",
                    .type = kTables,
                    .meaning = "Structures that the tool must keep away from."}}},
          .trajectory = {"[[trajectory]]",
                         "A straight path from an entry to a target. Only the tolerances given are checked.",
                         {{.name = "name", .type = kText, .meaning = "Unique. Required."},
                          planned_point("entry", "LPS. Required."),
                          planned_point("target", "LPS, 0.1 to 1000 mm from the entry. Required."),
                          {.name = "enters",
                           .type = kLabels,
                           .min = 1,
                           .max = 65535,
                           .meaning = "Structures whose common surface it enters. Default: the actual entry "
                                      "is the point of the path nearest to `entry`."},
                          allowed_mm("entry_within", "Allowed distance of the actual entry from `entry`."),
                          allowed_mm("target_within", "Allowed distance of the path from `target`."),
                          {.name = "angle_within",
                           .type = kNumber,
                           .unit = "degrees",
                           .min = 0.1,
                           .max = 90,
                           .meaning = "Allowed angle between the actual path and the trajectory."},
                          allowed_mm("depth_within",
                                     "Allowed difference, in either direction, of the actual depth from the "
                                     "trajectory's length.")}},
          .region =
              {"[[region]]",
               "Whole structures, or the part of them inside a shape on a trajectory.",
               {{.name = "name", .type = kText, .meaning = "Unique. Required."},
                {.name = "shape",
                 .type = kChoice,
                 .default_text = "\"structures\"",
                 .choices = {"structures", "sphere", "cylinder", "box"},
                 .meaning = "`structures`: the whole structures. The other shapes lie on a `trajectory`."},
                structures_key("Required for `structures`. For another shape: the structures inside it to "
                               "remove. Default: everything that a burr can remove."),
                {.name = "trajectory", .type = kText, .meaning = "For a shape: the name of its trajectory."},
                {.name = "radius",
                 .type = kNumber,
                 .unit = "mm",
                 .min = 0.1,
                 .max = 200,
                 .meaning = "For a sphere and a cylinder, required."},
                {.name = "from",
                 .type = kNumber,
                 .default_text = "0",
                 .unit = "mm",
                 .min = -1000,
                 .max = 1000,
                 .meaning = "For a cylinder and a box: start along the trajectory, measured from its entry; "
                            "negative in front of it."},
                {.name = "depth",
                 .type = kNumber,
                 .unit = "mm",
                 .min = -1000,
                 .max = 1000,
                 .meaning = "End along the trajectory; for a sphere its centre. Default: the target."},
                {.name = "width",
                 .type = kNumber,
                 .unit = "mm",
                 .min = 0.1,
                 .max = 400,
                 .meaning = "For a box, required: edge along `across`."},
                {.name = "height",
                 .type = kNumber,
                 .unit = "mm",
                 .min = 0.1,
                 .max = 400,
                 .meaning = "For a box, required: edge perpendicular to the trajectory and to `width`."},
                {.name = "across",
                 .type = kDirection,
                 .choices = direction_names(),
                 .meaning =
                     "For a box, required: direction of `width`, or a vector in LPS; projected perpendicular "
                     "to the trajectory, from which it must differ by at least 5 degrees."}}},
          .distance = {"[[keep_away]]",
                       "Minimum distance of the tool from structures.",
                       {structures_key("Structures to keep away from. Required."),
                        {.name = "distance",
                         .type = kNumber,
                         .unit = "mm",
                         .max = 100,
                         .meaning = "Minimum distance, from the outside of the tool's head. Required."}}}};
}

}  // namespace

const PlanKeys& plan_key_tables() {
  static const PlanKeys keys = declared_plan_keys();
  return keys;
}

std::string plan_keys() {
  const PlanKeys& keys = plan_key_tables();
  std::string text = table_markdown(keys.top);
  for (const TableSpec* table : {&keys.trajectory, &keys.region, &keys.distance})
    text += "\n" + table_markdown(*table);
  return text;
}

}  // namespace palpate
