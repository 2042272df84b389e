#include "palpate/scene/named_values.h"
#include "palpate/scene/script.h"
#include "scene/keys.h"

namespace palpate {
namespace {

using enum KeyType;

constexpr std::string_view kTargetMeaning =
    "The structure, by exact name or by number (`\"#95\"`): a place that a hand can reach is found from "
    "the labels. Or a point, LPS: the touchable structure with the nearest surface, at most 5 mm away.";

TableSpec script_table() {
  return {"top level",
          "The simulated hand and device.",
          {{.name = "title", .type = kText, .meaning = "Shown in the report."},
           {.name = "device",
            .type = kText,
            .default_text = "\"premium-1.5\"",
            .meaning = "`\"premium-1.5\"` or `\"touch\"`."},
           {.name = "hand",
            .type = kText,
            .default_text = "\"firm-grip\"",
            .meaning = "`\"light-grip\"`, `\"firm-grip\"` or `\"whole-arm\"`."},
           {.name = "rate",
            .type = kNumber,
            .default_text = "1000",
            .unit = "Hz",
            .min = 250,
            .max = 10000,
            .meaning = "Servo rate."},
           {.name = "delay",
            .type = kNumber,
            .default_text = "0",
            .unit = "ms",
            .min = 0,
            .max = 20,
            .meaning = "Delay from a command to its force, as added by a bus or a driver."},
           {.name = "tremor",
            .type = kNumber,
            .default_text = "0.03",
            .unit = "mm",
            .min = 0,
            .max = 1,
            .meaning = "Amplitude of the hand's tremor at 8 to 12 Hz."},
           {.name = "seed",
            .type = kInteger,
            .default_text = "1",
            .min = 0,
            .max = 9007199254740991.0,
            .meaning = "Seed of the tremor: the same seed gives the same run."},
           {.name = "step", .type = kTables, .meaning = "1 to 1000 steps, executed in order."}}};
}

TableSpec approach_action() {
  return {"approach",
          "Moves to a free place in front of a structure, then touches it. Contact with another structure "
          "must be left first.",
          {{.name = "approach",
            .type = kPosition,
            .unit = "mm",
            .min = -1e6,
            .max = 1e6,
            .meaning = kTargetMeaning},
           {.name = "landmark",
            .type = kChoice,
            .choices = direction_names(),
            .meaning = "Touches the most superior, most inferior, ... place of the structure, or one within "
                       "5 mm of that extent."},
           {.name = "nearest",
            .type = kPosition,
            .unit = "mm",
            .min = -1e6,
            .max = 1e6,
            .meaning = "Touches the structure where it is nearest to another one, or to a point, LPS; or "
                       "within 5 mm of that. Not together with `landmark`."},
           {.name = "from",
            .type = kDirection,
            .min = -1e6,
            .max = 1e6,
            .choices = direction_names(),
            .meaning = "Direction from which the hand arrives on the last, straight stretch; or a vector in "
                       "LPS. Default: a free path, along the surface's normal if possible."},
           {.name = "speed",
            .type = kNumber,
            .default_text = "40",
            .unit = "mm/s",
            .min = 0.1,
            .max = 200,
            .meaning = "Speed of the approach; lower near touchable structures, and for the touch itself."},
           {.name = "clearance",
            .type = kNumber,
            .default_text = "15",
            .unit = "mm",
            .min = 1,
            .max = 100,
            .meaning = "Maximum length of the last, straight stretch to the surface."}}};
}

TableSpec press_action() {
  return {"press",
          "Pushes along the surface's normal until the force is reached. Needs an approach before.",
          {{.name = "press",
            .type = kNumber,
            .unit = "N",
            .min = 0.02,
            .max = 40,
            .meaning = "The force. Limits still apply: a force above them is not reached."},
           {.name = "settle",
            .type = kNumber,
            .default_text = "0.5",
            .unit = "s",
            .min = 0,
            .max = 10,
            .meaning = "Time for which the force must stay within 10 % before the next step."}}};
}

TableSpec hold_action() {
  return {"hold",
          "Holds the force for this time: within 20 % of the force of the press, on the structure "
          "approached, without interruption. Needs an approach before.",
          {{.name = "hold", .type = kNumber, .unit = "s", .min = 0.01, .max = 60, .meaning = "Duration."}}};
}

TableSpec slide_action() {
  return {"slide",
          "Moves along the surface, keeping the force. Needs an approach before.",
          {{.name = "slide", .type = kNumber, .unit = "mm", .min = 0.1, .max = 200, .meaning = "Distance."},
           {.name = "direction",
            .type = kDirection,
            .default_text = "\"superior\"",
            .min = -1e6,
            .max = 1e6,
            .choices = direction_names(),
            .meaning = "Anatomical direction; or a vector in LPS: +x to the patient's left, +y posterior, "
                       "+z superior. The component normal to the surface and the length are ignored."},
           {.name = "speed",
            .type = kNumber,
            .default_text = "10",
            .unit = "mm/s",
            .min = 0.1,
            .max = 200,
            .meaning = "Speed along the surface; limited so that the hand can stop within a third of a "
                       "millimetre of an obstacle."}}};
}

TableSpec rotate_action() {
  return {"rotate",
          "Turns the object while the hand stays, commanded ten times per second. A hand in contact yields "
          "with the surface; one without contact moves back first.",
          {{.name = "rotate",
            .type = kNumber,
            .unit = "degrees",
            .min = -180,
            .max = 180,
            .meaning = "Angle, right-handed about the axis."},
           {.name = "axis",
            .type = kDirection,
            .default_text = "\"up\"",
            .min = -1e6,
            .max = 1e6,
            .choices = {"right", "forward", "up"},
            .meaning = "Axis of the workspace; or a vector in its coordinates: +x right, +y forward, +z up."},
           {.name = "seconds",
            .type = kNumber,
            .default_text = "1",
            .unit = "s",
            .min = 0.1,
            .max = 60,
            .meaning = "Duration of the turn."}}};
}

TableSpec method_action() {
  return {"method",
          "Changes the force method from here on; the force blends from the old to the new method within a "
          "tenth of a second.",
          {{.name = "method",
            .type = kChoice,
            .choices = names_of(kForceMethods),
            .meaning = "Name of a method of docs/concepts/methods.md."}}};
}

TableSpec leave_action() {
  return {"leave",
          "Withdraws along the path of the approach. Needs an approach before.",
          {{.name = "leave", .type = kFlag, .meaning = "`true`."},
           {.name = "speed",
            .type = kNumber,
            .default_text = "60",
            .unit = "mm/s",
            .min = 0.1,
            .max = 200,
            .meaning = "Speed of the withdrawal."}}};
}

TableSpec motor_action() {
  return {"motor",
          "Switches the motor of cutting tools on or off, at any position of the hand.",
          {{.name = "motor", .type = kFlag, .meaning = "`true`: on."}}};
}

TableSpec stroke_action() {
  return {"stroke",
          "Undoes the last stroke of a cutting tool, or redoes the last one that was undone, at any "
          "position of the hand. A stroke is everything cut between start and stop of the motor. The motor "
          "must be off, or the step fails.",
          {{.name = "stroke",
            .type = kChoice,
            .choices = {"undo", "redo"},
            .meaning = "`undo`: undoes the last stroke. `redo`: redoes the one that was undone last."}}};
}

TableSpec law_action() {
  return {"law",
          "Changes the law of soft tissue from here on, at any position of the hand. Changes between "
          "`elastic`, `neo-hookean` and `exponential`, and between `layers` and `chainmail`, are immediate. "
          "Between these groups the surfaces are prepared again; the hand waits for that, and until stiffer "
          "tissue has "
          "pushed it out to equilibrium. With a cutting tool a scene cannot change between the groups, and "
          "tissue that is fixed at the start cannot start to move.",
          {{.name = "law",
            .type = kChoice,
            .choices = names_of(kTissueLaws),
            .meaning = "As `law` of the scene's `[yielding]` (docs/concepts/tissue.md)."}}};
}

TableSpec scope_action() {
  return {"scope",
          "Points the scope of a second hand at a target from here on, at any position of the first hand: "
          "its camera moves straight there, through any obstacle, turns, and then follows the target. A "
          "script with such a step has two devices; the second is driven and has no contact. Only `palpate "
          "simulate` has that hand.",
          {{.name = "scope",
            .type = kPosition,
            .unit = "mm",
            .min = -1e6,
            .max = 1e6,
            .meaning = "Target in the centre of the picture: `\"probe\"`, the first device's tip; or a "
                       "point, LPS."},
           {.name = "from",
            .type = kDirection,
            .default_text = "\"anterior\"",
            .min = -1e6,
            .max = 1e6,
            .choices = direction_names(),
            .meaning = "Side of the target on which the camera is; or a direction in LPS."},
           {.name = "distance",
            .type = kNumber,
            .default_text = "20",
            .unit = "mm",
            .min = 1,
            .max = 200,
            .meaning = "Distance from the target to the camera."},
           {.name = "speed",
            .type = kNumber,
            .default_text = "40",
            .unit = "mm/s",
            .min = 0.1,
            .max = 200,
            .meaning = "Speed of the camera."},
           {.name = "optics",
            .type = kNumber,
            .default_text = "30",
            .unit = "degrees",
            .max = 90,
            .meaning = "Angle between the scope's shaft, which is tilted superiorly, and its direction of "
                       "view. Must equal that of the task (docs/guide/tasks.md)."},
           {.name = "back",
            .type = kNumber,
            .default_text = "8",
            .unit = "mm",
            .max = 30,
            .meaning = "Distance from the scope's tip back along its shaft to the camera. Must equal that "
                       "of the task."}}};
}

TableSpec mill_action() {
  return {"mill",
          "Guides a running burr in a straight line to a point, regardless of what it cuts or touches. "
          "Needs an approach and `motor = true` before.",
          {{.name = "mill",
            .type = kPoint,
            .unit = "mm",
            .min = -1e6,
            .max = 1e6,
            .meaning = "LPS: the centre of the burr's head at the end."},
           {.name = "force",
            .type = kNumber,
            .default_text = "1",
            .unit = "N",
            .min = 0.01,
            .max = 20,
            .meaning = "Maximum force of the hand."},
           {.name = "speed",
            .type = kNumber,
            .default_text = "8",
            .unit = "mm/s",
            .min = 0.1,
            .max = 200,
            .meaning = "Speed of the hand without resistance."}}};
}

}  // namespace

const ScriptKeys& script_key_tables() {
  static const ScriptKeys keys{.top = script_table(),
                               .actions = {approach_action(), press_action(), hold_action(), slide_action(),
                                           rotate_action(), method_action(), leave_action(), motor_action(),
                                           stroke_action(), law_action(), scope_action(), mill_action()}};
  return keys;
}

std::string script_keys() {
  const ScriptKeys& keys = script_key_tables();
  std::string text = table_markdown(keys.top);
  for (const TableSpec& action : keys.actions) text += "\n" + table_markdown(action);
  return text;
}

}  // namespace palpate
