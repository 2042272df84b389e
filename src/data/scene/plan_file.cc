#include "palpate/scene/plan_file.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "palpate/base/file.h"
#include "palpate/base/hash.h"
#include "scene/plan_keys.h"
#include "scene/table_reader.h"
#include "scene/toml_text.h"

namespace palpate {
namespace {

constexpr std::string_view kSplitPlan = "split the plan";
constexpr double kMinTurn_deg = 5;  // minimum angle between a box's `across` and its trajectory

struct ShapeWord {
  PlanShape shape;
  std::string_view name;
};
constexpr std::array<ShapeWord, 4> kShapeWords{{{PlanShape::kStructures, "structures"},
                                                {PlanShape::kSphere, "sphere"},
                                                {PlanShape::kCylinder, "cylinder"},
                                                {PlanShape::kBox, "box"}}};
std::string_view word_of(PlanShape shape) {
  return std::ranges::find(kShapeWords, shape, &ShapeWord::shape)->name;
}

template <class Part>
void check_unique(const std::vector<Part>& parts, const Part& part, std::string_view kind,
                  const TableReader& reader, Problems& problems) {
  if (!part.name.empty() && std::ranges::find(parts, part.name, &Part::name) != parts.end())
    problems.add(reader.line("name"), "a second " + std::string(kind) + " \"" + part.name + "\"",
                 "give it another name");
}

void read_trajectories(const TableReader& top, PlanFile& plan, Problems& problems) {
  for (const TomlTable* table : limited_tables(top, "trajectory", kMaxPlanParts, kSplitPlan, problems)) {
    const TableReader reader(table, plan_key_tables().trajectory, problems);
    PlanTrajectory trajectory;
    trajectory.line = table->line;
    trajectory.name = required_name(reader, "a [[trajectory]]", problems);
    const auto entry = reader.point("entry"), target = reader.point("target");
    for (const std::string_view key : {"entry", "target"})
      if (!reader.has(key))
        problems.add_missing(reader.line(), "a [[trajectory]] without " + std::string(key),
                             "add " + std::string(key) + " = [x, y, z], LPS in millimetres");
    if (entry) trajectory.entry = Point<Patient>(*entry);
    if (target) trajectory.target = Point<Patient>(*target);
    if (entry && target && trajectory.length_mm() < kMinTrajectory_mm)
      problems.add(reader.line("target"), "entry and target are the same place",
                   "they must be at least 0.1 mm apart");
    if (entry && target && trajectory.length_mm() > kMaxTrajectory_mm)
      problems.add(reader.line("target"),
                   "entry and target are " + number_text(std::round(trajectory.length_mm())) + " mm apart",
                   "a trajectory may be at most 1000 mm long");
    if (auto labels = reader.labels("enters")) trajectory.enters = std::move(labels->references);
    trajectory.entry_within_mm = reader.number("entry_within");
    trajectory.target_within_mm = reader.number("target_within");
    trajectory.angle_within_deg = reader.number("angle_within");
    trajectory.depth_within_mm = reader.number("depth_within");
    check_unique(plan.trajectories, trajectory, "trajectory", reader, problems);
    plan.trajectories.push_back(std::move(trajectory));
  }
}

/// Shapes for which a key of a [[region]] is accepted, and whether it is required.
struct ShapeKey {
  std::string_view key;
  std::array<PlanShape, 3> shapes;  // padded by repeating the last one
  bool needed;
};
constexpr std::array<ShapeKey, 7> kShapeKeys{{
    {"trajectory", {PlanShape::kSphere, PlanShape::kCylinder, PlanShape::kBox}, true},
    {"radius", {PlanShape::kSphere, PlanShape::kCylinder, PlanShape::kCylinder}, true},
    {"from", {PlanShape::kCylinder, PlanShape::kBox, PlanShape::kBox}, false},
    {"depth", {PlanShape::kSphere, PlanShape::kCylinder, PlanShape::kBox}, false},
    {"width", {PlanShape::kBox, PlanShape::kBox, PlanShape::kBox}, true},
    {"height", {PlanShape::kBox, PlanShape::kBox, PlanShape::kBox}, true},
    {"across", {PlanShape::kBox, PlanShape::kBox, PlanShape::kBox}, true},
}};

void check_shape_keys(const TableReader& reader, PlanShape shape, Problems& problems) {
  for (const ShapeKey& key : kShapeKeys) {
    const bool takes = std::ranges::find(key.shapes, shape) != key.shapes.end();
    const std::string name(key.key), word(word_of(shape));
    if (reader.has(key.key) && !takes)
      problems.add(reader.line(key.key), name + " of a region whose shape is \"" + word + "\"",
                   "remove it, or write another shape");
    if (!reader.has(key.key) && takes && key.needed)
      problems.add_missing(reader.line(), "a region whose shape is \"" + word + "\" without " + name,
                           "add " + name);
  }
  if (shape == PlanShape::kStructures && !reader.has("structures"))
    problems.add_missing(reader.line(), "a [[region]] without structures and without a shape",
                         "add structures = [\"...\"], or shape = \"cylinder\" and its trajectory");
}

/// Component of a direction perpendicular to a trajectory, normalised. Empty if the direction is nearly
/// parallel.
std::optional<Vector<Patient>> perpendicular_direction(const Vector<Patient>& direction,
                                                       const Vector<Patient>& axis) {
  // a unit vector that is already perpendicular is returned unchanged, bit for bit
  constexpr double kRounding = 1e-12;
  const Vector<Patient> unit =
      std::abs(direction.norm() - 1) < kRounding ? direction : direction.normalized();
  if (std::abs(unit.dot(axis)) < kRounding) return unit;
  const Vector<Patient> across = unit - axis * unit.dot(axis);
  if (across.norm() < std::sin(kMinTurn_deg * std::numbers::pi / 180)) return std::nullopt;
  return across.normalized();
}

void read_plan_regions(const TableReader& top, PlanFile& plan, Problems& problems) {
  std::vector<std::string_view> known;
  for (const PlanTrajectory& trajectory : plan.trajectories) known.push_back(trajectory.name);
  for (const TomlTable* table : limited_tables(top, "region", kMaxPlanParts, kSplitPlan, problems)) {
    const TableReader reader(table, plan_key_tables().region, problems);
    PlanRegion region;
    region.line = table->line;
    region.name = required_name(reader, "a [[region]]", problems);
    const auto shape = reader.choice("shape");
    if (shape) region.shape = std::ranges::find(kShapeWords, *shape, &ShapeWord::name)->shape;
    region.structures = structures_of(reader, "a [[region]]", false, problems);
    if (shape || !reader.has("shape")) check_shape_keys(reader, region.shape, problems);
    const auto trajectory = reader.text("trajectory");
    const auto found = trajectory ? std::ranges::find(known, *trajectory) : known.end();
    if (trajectory && found == known.end())
      problems.add(reader.line("trajectory"), "there is no trajectory \"" + *trajectory + "\"",
                   did_you_mean(*trajectory, known, "\"") + "add a [[trajectory]] of that name");
    region.radius_mm = reader.number("radius").value_or(0);
    region.from_mm = reader.number("from").value_or(0);
    const auto depth = reader.number("depth");
    region.depth_mm = depth.value_or(0);
    region.width_mm = reader.number("width").value_or(0);
    region.height_mm = reader.number("height").value_or(0);
    const auto across = reader.direction("across");
    if (found != known.end()) {
      region.trajectory = static_cast<std::size_t>(found - known.begin());
      const PlanTrajectory& along = plan.trajectories[region.trajectory];
      if (!depth && region.shape != PlanShape::kStructures) region.depth_mm = along.length_mm();
      if ((region.shape == PlanShape::kCylinder || region.shape == PlanShape::kBox) &&
          !(region.from_mm < region.depth_mm))
        problems.add(reader.line(reader.has("from") ? "from" : "depth"),
                     "the region \"" + region.name + "\" ends at " + number_text(region.depth_mm) +
                         " mm, before its start",
                     "write a depth that is greater than from");
      if (across) {
        const auto* vector = std::get_if<Eigen::Vector3d>(&*across);
        const auto made = perpendicular_direction(
            vector ? Vector<Patient>(*vector) : direction_named(std::get<std::string>(*across)),
            along.axis());
        if (made)
          region.across = *made;
        else
          problems.add(reader.line("across"), "across points along the trajectory",
                       "write a direction that differs from it by at least 5 degrees");
      }
    }
    check_unique(plan.regions, region, "region", reader, problems);
    plan.regions.push_back(std::move(region));
  }
}

void read_distances(const TableReader& top, PlanFile& plan, Problems& problems) {
  for (const TomlTable* table : limited_tables(top, "keep_away", kMaxPlanParts, kSplitPlan, problems)) {
    const TableReader reader(table, plan_key_tables().distance, problems);
    PlanDistance distance;
    distance.line = table->line;
    distance.structures = structures_of(reader, "a [[keep_away]]", true, problems);
    distance.distance_mm = reader.number("distance").value_or(0);
    if (!reader.has("distance"))
      problems.add_missing(reader.line(), "a [[keep_away]] without distance", "add distance, in millimetres");
    plan.distances.push_back(std::move(distance));
  }
}

// ---- writing

// negative zero becomes 0, because TOML integers have no signed zero
std::string plan_number(double value) {
  return number_text(value == 0 ? 0 : value);
}
std::string list_text(const Eigen::Vector3d& v) {
  return "[" + plan_number(v.x()) + ", " + plan_number(v.y()) + ", " + plan_number(v.z()) + "]";
}
std::string list_text(const std::vector<LabelReference>& structures) {
  std::string text = "[";
  for (const LabelReference& structure : structures) {
    if (text.size() > 1) text += ", ";
    const auto* number = std::get_if<int>(&structure);
    text += number != nullptr ? std::to_string(*number) : toml_string(std::get<std::string>(structure));
  }
  return text + "]";
}
std::string number_line(std::string_view key, const std::optional<double>& value) {
  return value ? std::string(key) + " = " + plan_number(*value) + "\n" : "";
}

std::string text_of(const PlanTrajectory& trajectory) {
  std::string text = "\n[[trajectory]]\nname = " + toml_string(trajectory.name) +
                     "\nentry = " + list_text(trajectory.entry.eigen()) +
                     "\ntarget = " + list_text(trajectory.target.eigen()) + "\n";
  if (!trajectory.enters.empty()) text += "enters = " + list_text(trajectory.enters) + "\n";
  return text + number_line("entry_within", trajectory.entry_within_mm) +
         number_line("target_within", trajectory.target_within_mm) +
         number_line("angle_within", trajectory.angle_within_deg) +
         number_line("depth_within", trajectory.depth_within_mm);
}

std::string text_of(const PlanRegion& region, const PlanFile& plan) {
  std::string text = "\n[[region]]\nname = " + toml_string(region.name) + "\n";
  if (!region.structures.empty()) text += "structures = " + list_text(region.structures) + "\n";
  if (region.shape == PlanShape::kStructures) return text;
  text += "shape = \"" + std::string(word_of(region.shape)) +
          "\"\ntrajectory = " + toml_string(plan.trajectories[region.trajectory].name) + "\n";
  if (region.shape != PlanShape::kBox) text += number_line("radius", region.radius_mm);
  if (region.shape != PlanShape::kSphere) text += number_line("from", region.from_mm);
  text += number_line("depth", region.depth_mm);
  if (region.shape == PlanShape::kBox)
    text += number_line("width", region.width_mm) + number_line("height", region.height_mm) +
            "across = " + list_text(region.across.eigen()) + "\n";
  return text;
}

}  // namespace

// leading comments and blank lines, up to the last comment before the first key
static std::string heading_of(std::string_view text) {
  std::size_t end = 0;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t next = std::min(text.find('\n', at), text.size() - 1) + 1;
    const std::string_view line = text.substr(at, next - at);
    const std::size_t first = line.find_first_not_of(" \t\r\n");
    if (first != line.npos && line[first] != '#') break;
    at = next;
    if (first != line.npos) end = next;
  }
  return std::string(text.substr(0, end));
}

Result<PlanFile> parse_plan(std::string_view text, const std::string& source) {
  if (text.find_first_not_of(" \t\r\n") != std::string_view::npos &&
      text[text.find_first_not_of(" \t\r\n")] == '{')
    return Error{ErrorKind::kBadInput, "this is JSON, not a plan", source,
                 "palpate plan from-markups creates a plan from 3D Slicer markups"};
  const auto document = parse_toml(text, kMaxSceneBytes, source);
  if (!document) return document.error();
  for (const auto& [key, kind] : {std::pair("tissue", "a scene"), std::pair("step", "a script or a task")})
    if (const TomlValue* value = document->find(key))
      return Error{ErrorKind::kBadInput, "this is " + std::string(kind) + ", not a plan",
                   source + ":" + std::to_string(value->line), "docs/guide/rehearsal.md describes plans"};

  Problems problems(source);
  PlanFile plan;
  plan.source = source;
  plan.heading = heading_of(text);
  hash_bytes(plan.text_hash = kHashSeed, text.data(), text.size());
  plan.text_hash = hash_finish(plan.text_hash);
  const TableReader top(&*document, plan_key_tables().top, problems);
  plan.title = top.text("title").value_or("");
  if (!top.has("title")) problems.add_missing(1, "the plan has no title", "add title = \"...\" at the top");
  read_trajectories(top, plan, problems);
  read_plan_regions(top, plan, problems);
  read_distances(top, plan, problems);
  if (plan.trajectories.empty() && plan.regions.empty() && plan.distances.empty())
    problems.add_missing(1, "the plan is empty", "add a [[trajectory]], a [[region]] or a [[keep_away]]");
  if (problems.any()) return problems.first();
  return plan;
}

Result<PlanFile> load_plan(const std::string& name_or_file, const std::filesystem::path& beside) {
  if (const EmbeddedFile* known = find_file(embedded_plans(), name_or_file + ".toml"))
    return parse_plan(known->text, name_or_file + ".toml");
  const std::filesystem::path file = beside / name_or_file;
  const auto text = read_file(file, kMaxSceneBytes);
  if (!text) return text.error();
  return parse_plan(*text, file.string());
}

std::string plan_text(const PlanFile& plan) {
  std::string text = plan.heading + "title = " + toml_string(plan.title) + "\n";
  for (const PlanTrajectory& trajectory : plan.trajectories) text += text_of(trajectory);
  for (const PlanRegion& region : plan.regions) text += text_of(region, plan);
  for (const PlanDistance& distance : plan.distances)
    text += "\n[[keep_away]]\nstructures = " + list_text(distance.structures) + "\n" +
            number_line("distance", distance.distance_mm);
  return text;
}

}  // namespace palpate
