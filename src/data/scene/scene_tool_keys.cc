#include "palpate/contact/tissue_values.h"
#include "palpate/scene/named_values.h"
#include "palpate/scene/scene.h"
#include "scene/scene_tables.h"

namespace palpate {
namespace {

using enum KeyType;

}  // namespace

TableSpec tool_table() {
  return {
      "[tool]",
      "A rigid set of spheres, and of capsules (below), that make contact; the first one is usually at "
      "the origin, the tip. The proxy uses their full shape, the other methods the centres of the "
      "spheres.",
      {{.name = "name", .type = kText, .default_text = "\"point\"", .meaning = "Shown in the report."},
       {.name = "points",
        .type = kPoints,
        .default_text = "[[0, 0, 0]]",
        .unit = "mm",
        .min = -100,
        .max = 100,
        .meaning = "1 to 4 points [x, y, z] in the tip's frame."},
       {.name = "radius",
        .type = kNumber,
        .default_text = "0",
        .unit = "mm",
        .min = 0,
        .max = kMaxToolRadius_mm,
        .meaning = "Radius of the sphere at every point; used by the proxy."},
       {.name = "capsule",
        .type = kTables,
        .meaning = "Elongated parts, such as a shaft or a hook. At most 4 points and capsules together.",
        .heading_prefix = "tool."},
       {.name = "kind",
        .type = kChoice,
        .default_text = "\"probe\"",
        .choices = {"probe", "burr", "shaver"},
        .meaning = "A burr removes the tissue that it touches while its motor runs, a shaver only soft "
                   "tissue ([burr.md](../guide/burr.md#a-shaver)). They have no `points`, `radius` and "
                   "`capsule`, and require the proxy."},
       {.name = "shape",
        .type = kChoice,
        .default_text = "\"ball\"",
        .choices = {"ball", "cylinder", "cone"},
        .meaning = "Shape of a burr's head. Cylinders and cones have round ends, because voxels cannot "
                   "represent a sharp edge. The centre of the ball at the tip is at the device's tip, "
                   "and the head extends from there along `spindle`."},
       {.name = "diameter",
        .type = kNumber,
        .default_text = "4",
        .unit = "mm",
        .min = 1,
        .max = 6,
        .meaning = "Diameter of a burr, or of a cone at its far end; at least two voxels. Default for a "
                   "shaver: 5.5."},
       {.name = "length",
        .type = kNumber,
        .unit = "mm",
        .min = 1,
        .max = 20,
        .meaning = "Length of the whole head of a cylinder or cone; greater than its width."},
       {.name = "tip_diameter",
        .type = kNumber,
        .unit = "mm",
        .min = 0.5,
        .max = 6,
        .meaning = "Diameter of a cone at its tip, which may be the wider end; at least two voxels."},
       {.name = "speed",
        .type = kNumber,
        .default_text = "60000",
        .unit = "1/min",
        .min = 100,
        .max = 200000,
        .meaning = "For a burr: speed of rotation while its motor runs. Default for a shaver: 2500."},
       {.name = "spindle",
        .type = kPoint,
        .default_text = "[0, 0, 1]",
        .min = -1,
        .max = 1,
        .meaning = "For a burr: direction of its axis in the tip's frame, from the tip to the handle. "
                   "Parts of the head near the axis cut little."},
       {.name = "grip",
        .type = kNumber,
        .default_text = "0.5",
        .min = 0.05,
        .max = 2,
        .meaning = "For a burr: ratio of the force along the cutting edges to the normal force."},
       {.name = "flutes",
        .type = kInteger,
        .default_text = "8",
        .min = 1,
        .max = 100,
        .meaning = "For a burr: number of its cutting edges, which determines the vibration. Default for a "
                   "shaver: 2."},
       {.name = "irrigation",
        .type = kFlag,
        .default_text = "true",
        .meaning = "For a burr: whether it is cooled. Otherwise the temperature rise of the bone is "
                   "estimated and recorded."},
       {.name = "pedal",
        .type = kInteger,
        .min = 0,
        .max = 31,
        .meaning = "For a burr: device button that runs its motor while pressed. Default: the page, the "
                   "keys and the script switch the motor."}}};
}

TableSpec capsule_table() {
  return {"[[tool.capsule]]",
          "A cylinder with round ends, fixed to the tool; used by the proxy only.",
          {{.name = "from",
            .type = kPoint,
            .unit = "mm",
            .min = -300,
            .max = 300,
            .meaning = "One end of its axis, in the tip's frame. Required."},
           {.name = "to",
            .type = kPoint,
            .unit = "mm",
            .min = -300,
            .max = 300,
            .meaning = "The other end, at least 0.1 mm away. Required."},
           {.name = "radius",
            .type = kNumber,
            .unit = "mm",
            .min = 0,
            .max = kMaxToolRadius_mm,
            .meaning = "Default: the tool's `radius`."}}};
}

SceneKeys with_second_tool(SceneKeys keys) {
  keys.second_tool = keys.tool;
  keys.second_tool.heading = "[second_tool]";
  for (KeySpec& key : keys.second_tool.keys)
    if (key.type == kTables) key.heading_prefix = "second_tool.";
  keys.second_capsule = keys.capsule;
  keys.second_capsule.heading = "[[second_tool.capsule]]";
  return keys;
}

}  // namespace palpate
