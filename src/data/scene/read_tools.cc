#include "scene/read_tools.h"

#include <algorithm>
#include <span>
#include <string>
#include <utility>

namespace palpate {
namespace {

void read_capsule(const TomlTable& table, const TableSpec& keys, Tool& tool, Problems& problems) {
  const TableReader reader(&table, keys, problems);
  const auto from = reader.point("from"), to = reader.point("to");
  for (const char* end : {"from", "to"})
    if (!reader.has(end))
      problems.add_missing(reader.line(), std::string("a capsule without `") + end + "`",
                           std::string("add: ") + end + " = [x, y, z], in millimetres from the tip");
  if (!from || !to) return;
  constexpr double kMinLength_mm = 0.1;
  if ((*to - *from).norm() < kMinLength_mm) {
    problems.add(reader.line("to"), "a capsule whose ends are less than 0.1 mm apart",
                 "move one end, or write a point");
    return;
  }
  tool.capsules.push_back({*from, *to, reader.number("radius").value_or(tool.radius_mm)});
}

// length in millimetres for messages
std::string in_mm(double mm) {
  char text[32];
  std::snprintf(text, sizeof text, "%g mm", mm);
  return text;
}

// dimensions of a cylinder or cone besides its `diameter`: the row of spheres from its tip to its far end
void read_row(const TableReader& reader, bool is_cone, Tool& tool, BurrSettings& burr, Problems& problems) {
  const std::string shape = is_cone ? "cone" : "cylinder";
  const auto length_mm = reader.number("length"), tip_mm = reader.number("tip_diameter");
  if (!reader.has("length"))
    problems.add_missing(reader.line("shape"), "a " + shape + " without `length`",
                         "add: length = 8, in millimetres from its tip to its far end");
  if (is_cone && !reader.has("tip_diameter"))
    problems.add_missing(reader.line("shape"), "a cone without `tip_diameter`",
                         "add: tip_diameter = 1.2, in millimetres; `diameter` applies to its far end");
  if (!is_cone && reader.has("tip_diameter"))
    problems.add(reader.line("tip_diameter"), "a cylinder has no `tip_diameter`",
                 "it is as wide at its tip: leave this out, or write shape = \"cone\"");
  if (!length_mm || (is_cone && !tip_mm)) return;
  const double end_mm = 2 * tool.radius_mm, first_mm = is_cone ? *tip_mm : end_mm;
  if (is_cone && first_mm == end_mm) {
    problems.add(reader.line("tip_diameter"), "a cone as wide at its tip as at its far end",
                 "write shape = \"cylinder\" and leave `tip_diameter` out, or change one of them");
    return;
  }
  // one end sphere would contain the other
  const double widest_mm = std::max(first_mm, end_mm);
  if (*length_mm <= widest_mm) {
    problems.add(
        reader.line("length"),
        "a " + shape + " of " + in_mm(widest_mm) + " that is " + in_mm(*length_mm) + " long",
        "with its round ends it is longer than wide: make `length` larger, or write shape = \"ball\"");
    return;
  }
  tool.radius_mm = 0.5 * first_mm;
  burr.end_radius_mm = 0.5 * end_mm;
  burr.length_mm = *length_mm - 0.5 * (first_mm + end_mm);
}

// reads a burr, or a shaver: a burr that turns slowly and cuts soft tissue
void read_burr(const TableReader& reader, bool is_shaver, Tool& tool, Problems& problems) {
  BurrSettings burr;
  burr.shaver = is_shaver;
  constexpr double kSecondsPerMinute = 60;
  // resection rate of tendon and meniscus is best at 5.5 mm and 2000 to 2500 1/min (docs/guide/burr.md)
  constexpr double kShaver_mm = 5.5, kShaverSpeed_per_min = 2500, kBurr_mm = 4;
  constexpr int kShaverFlutes = 2;
  const std::string kind = is_shaver ? "shaver" : "burr";
  for (const char* key : {"points", "radius", "capsule"})
    if (reader.has(key))
      problems.add(reader.line(key), "a " + kind + " has no `" + key + "`",
                   "a burr is defined by the shape of its head: give its diameter, and leave this out");
  tool.radius_mm = 0.5 * reader.number("diameter").value_or(is_shaver ? kShaver_mm : kBurr_mm);
  if (is_shaver) {
    if (!reader.has("name")) tool.name = kind;
    burr.revolutions_per_s = kShaverSpeed_per_min / kSecondsPerMinute;
    burr.flutes = kShaverFlutes;
  }
  const std::string shape = std::string(reader.choice("shape").value_or("ball"));
  if (is_shaver && shape == "cone")
    problems.add(reader.line("shape"), "a shaver cannot be a cone",
                 "write shape = \"cylinder\" or shape = \"ball\", or kind = \"burr\"");
  if (shape != "ball") read_row(reader, shape == "cone", tool, burr, problems);
  for (const char* key : {"length", "tip_diameter"})
    if (shape == "ball" && reader.has(key))
      problems.add(reader.line(key), std::string("a ball has no `") + key + "`",
                   "leave this out, or write shape = \"cylinder\" or shape = \"cone\"");
  if (const auto speed = reader.number("speed")) burr.revolutions_per_s = *speed / kSecondsPerMinute;
  burr.grip = reader.number("grip").value_or(burr.grip);
  if (const auto flutes = reader.integer("flutes")) burr.flutes = static_cast<int>(*flutes);
  burr.irrigation = reader.flag("irrigation").value_or(burr.irrigation);
  if (const auto pedal = reader.integer("pedal")) burr.pedal = static_cast<int>(*pedal);
  if (const auto spindle = reader.point("spindle")) {
    constexpr double kMinNorm = 1e-3;
    if (spindle->norm() < kMinNorm)
      problems.add(reader.line("spindle"), "the spindle has no direction",
                   "write spindle = [x, y, z], such as [0, 0, 1]");
    else
      burr.spindle = spindle->normalized();
  }
  tool.burr = burr;
}

void read_parts(const TableReader& reader, const TableSpec& capsule, Tool& tool, Problems& problems) {
  for (const char* key : {"shape", "diameter", "length", "tip_diameter", "speed", "spindle", "grip", "flutes",
                          "irrigation", "pedal"})
    if (reader.has(key))
      problems.add(reader.line(key), std::string("`") + key + "` is a key of burrs",
                   "add kind = \"burr\" or kind = \"shaver\", or leave this out");
  tool.radius_mm = reader.number("radius").value_or(tool.radius_mm);
  tool.points_mm = reader.points("points").value_or(tool.points_mm);
  if (tool.points_mm.empty() || tool.points_mm.size() > kMaxToolParts) {
    problems.add(reader.line("points"), "points has " + std::to_string(tool.points_mm.size()) + " points",
                 "a tool has 1 to " + std::to_string(kMaxToolParts) + " points");
    return;
  }
  for (const TomlTable* table : reader.tables("capsule")) read_capsule(*table, capsule, tool, problems);
  if (const std::size_t parts = tool.points_mm.size() + tool.capsules.size(); parts > kMaxToolParts)
    problems.add(
        reader.line("capsule"), "the tool has " + std::to_string(parts) + " points and capsules",
        "together they may be " + std::to_string(kMaxToolParts) + "; without `points` the tip is one point");
}

struct ReadTool {
  Tool tool;
  bool is_shaver = false;
};

// reads a tool; without a table it is a point
ReadTool read_tool(const TomlTable* table, const TableSpec& keys, const TableSpec& capsule,
                   ForceMethod method, Problems& problems) {
  Tool tool;
  const TableReader reader(table, keys, problems);
  tool.name = reader.text("name").value_or(tool.name);
  const auto kind = reader.choice("kind");
  const bool is_shaver = kind == "shaver";
  if (kind == "burr" || is_shaver)
    read_burr(reader, is_shaver, tool, problems);
  else
    read_parts(reader, capsule, tool, problems);
  if (tool.burr && method != ForceMethod::kProxy)
    problems.add(reader.line("kind"), std::string(is_shaver ? "a shaver" : "a burr") + " requires the proxy",
                 "set [force] method = \"proxy\", or leave method out");
  return {std::move(tool), is_shaver};
}

// A shaver cuts tissues that have a modulus or an explicit cutting energy; others, such as bone, are
// protected from it. Protection applies to a structure regardless of the tool, so with a burr as the other
// tool the scene has to set it explicitly.
void protect_from_shavers(const TableReader& top, std::span<const ReadTool> tools, Scene& scene,
                          Problems& problems) {
  // cutting energy of soft tissue: 1 kJ/m2, the toughness of cartilage, in slices of 0.2 mm
  // (docs/guide/burr.md)
  constexpr double kSoft_mJ_per_mm3 = 5;
  const auto any = [&](bool is_shaver) {
    return std::any_of(tools.begin(), tools.end(),
                       [&](const ReadTool& read) { return read.tool.burr && read.is_shaver == is_shaver; });
  };
  if (!any(true)) return;
  const auto tables = top.tables("tissue");
  for (std::size_t n = 0; n < scene.tissues.size(); ++n) {
    TissueSettings& tissue = scene.tissues[n];
    // errors of this table have already been reported
    Problems step_problems(scene.source);
    const TableReader reader(tables[n], scene_key_tables().tissue, step_problems);
    if (reader.has("cutting_energy")) continue;
    if (tissue.elastic) {
      tissue.cutting_energy_mJ_per_mm3 = kSoft_mJ_per_mm3;
    } else if (tissue.touchable && !reader.has("protection")) {
      if (any(false))
        problems.add_missing(
            tissue.line,
            "tissue \"" + tissue.name + "\" cannot be cut by a shaver, but one of the tools is a burr",
            "add protection = \"keep\", so that neither cuts it, or \"none\", so that both do");
      tissue.protection = Protection::kBlock;
    }
  }
}

}  // namespace

void read_tools(const TableReader& top, Scene& scene, Problems& problems) {
  const SceneKeys& keys = scene_key_tables();
  std::vector<ReadTool> read{
      read_tool(top.table("tool"), keys.tool, keys.capsule, scene.force.method, problems)};
  if (top.has("second_tool")) {
    Problems of_second(scene.source);
    read.push_back(read_tool(top.table("second_tool"), keys.second_tool, keys.second_capsule,
                             scene.force.method, of_second));
    problems.add_from(of_second, keys.second_tool.heading);
  }
  protect_from_shavers(top, read, scene, problems);
  scene.tools.clear();
  for (ReadTool& one : read) scene.tools.push_back(std::move(one.tool));
}

}  // namespace palpate
