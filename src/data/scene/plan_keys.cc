#include "scene/plan_keys.h"

#include "palpate/scene/plan_file.h"

namespace palpate {
namespace {

using enum KeyType;

KeySpec planned_point(std::string_view name, std::string_view meaning) {
  constexpr double kFarthest_mm = 100000;
  return {.name = name,
          .type = kPoint,
          .unit = "mm",
          .min = -kFarthest_mm,
          .max = kFarthest_mm,
          .meaning = meaning};
}

KeySpec allowed_mm(std::string_view name, std::string_view meaning) {
  return {.name = name, .type = kNumber, .unit = "mm", .min = 0.01, .max = 100, .meaning = meaning};
}

PlanKeys declared_plan_keys() {
  return {
      .top = {"top level",
              "What the plan is called. It has at least one of its tables.",
              {{.name = "title", .type = kText, .meaning = "Has to be there."},
               {.name = "trajectory", .type = kTables, .meaning = "Straight ways into the patient."},
               {.name = "region", .type = kTables, .meaning = "What is to be taken off."},
               {.name = "keep_away", .type = kTables, .meaning = "What the tool is to keep away from."}}},
      .trajectory =
          {"[[trajectory]]",
           "From an entry to a target, straight. What is allowed counts where it is given.",
           {{.name = "name", .type = kText, .meaning = "Unique. Has to be there."},
            planned_point("entry", "LPS. Has to be there."),
            planned_point("target", "LPS, 0.1 to 1000 mm from the entry. Has to be there."),
            {.name = "enters",
             .type = kLabels,
             .min = 1,
             .max = 65535,
             .meaning = "Structures whose surface it enters, as if they were one. Without it the entry made "
                        "is the place of the way that is nearest to `entry`."},
            allowed_mm("entry_within", "Allowed distance of the entry made from `entry`."),
            allowed_mm("target_within", "Allowed distance of the way from `target`."),
            {.name = "angle_within",
             .type = kNumber,
             .unit = "degrees",
             .min = 0.1,
             .max = 90,
             .meaning = "Allowed angle between the way made and the trajectory."},
            allowed_mm("depth_within",
                       "Allowed difference of the depth made from the trajectory's length, "
                       "either way.")}},
      .region =
          {"[[region]]",
           "All of some structures, or what of them lies in a shape on a trajectory.",
           {{.name = "name", .type = kText, .meaning = "Unique. Has to be there."},
            {.name = "shape",
             .type = kChoice,
             .default_text = "\"structures\"",
             .choices = {"structures", "sphere", "cylinder", "box"},
             .meaning = "`structures`: all of them. The others lie on a `trajectory`."},
            structures_key("Of `structures` they have to be there. A shape is of them alone; without them of "
                           "all that a burr can take off."),
            {.name = "trajectory", .type = kText, .meaning = "Of a shape: the name of one."},
            {.name = "radius",
             .type = kNumber,
             .unit = "mm",
             .min = 0.1,
             .max = 200,
             .meaning = "Of a sphere and a cylinder, which have to have it."},
            {.name = "from",
             .type = kNumber,
             .default_text = "0",
             .unit = "mm",
             .min = -1000,
             .max = 1000,
             .meaning = "Of a cylinder and a box: where they begin, along the trajectory from its entry; "
                        "below 0 before it."},
            {.name = "depth",
             .type = kNumber,
             .unit = "mm",
             .min = -1000,
             .max = 1000,
             .meaning = "Where they end, likewise; of a sphere where its middle is. Without it at the "
                        "target."},
            {.name = "width",
             .type = kNumber,
             .unit = "mm",
             .min = 0.1,
             .max = 400,
             .meaning = "Of a box, which has to have it: its edge along `across`."},
            {.name = "height",
             .type = kNumber,
             .unit = "mm",
             .min = 0.1,
             .max = 400,
             .meaning = "Of a box, which has to have it: its edge across both the trajectory and `width`."},
            {.name = "across",
             .type = kDirection,
             .choices = direction_names(),
             .meaning = "Of a box, which has to have it: the direction of `width`, or in LPS; made "
                        "perpendicular to the trajectory, from which it has to differ by 5 degrees and "
                        "more."}}},
      .distance = {"[[keep_away]]",
                   "How far the tool is to keep away from structures.",
                   {structures_key("From each of them. Has to be there."),
                    {.name = "distance",
                     .type = kNumber,
                     .unit = "mm",
                     .max = 100,
                     .meaning = "From the outside of the tool's head. Has to be there."}}}};
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
