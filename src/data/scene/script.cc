#include <algorithm>

#include "palpate/base/file.h"
#include "palpate/scene/named_values.h"
#include "palpate/scene/scene.h"
#include "palpate/scene/script.h"
#include "scene/table_reader.h"

namespace palpate {
namespace {

constexpr std::array<std::pair<std::string_view, std::array<double, 3>>, 3> kWorldDirections{
    {{"right", {1, 0, 0}}, {"forward", {0, 1, 0}}, {"up", {0, 0, 1}}}};

template <class Names>
Eigen::Vector3d vector_of(const std::variant<std::string, Eigen::Vector3d>& direction, const Names& names) {
  if (const auto* vector = std::get_if<Eigen::Vector3d>(&direction)) return *vector;
  const auto found = std::find_if(names.begin(), names.end(), [&](const auto& named) {
    return named.first == std::get<std::string>(direction);
  });
  PALPATE_CHECK(found != names.end());
  return {found->second[0], found->second[1], found->second[2]};
}

/// Whether a text is a name or a valid label number ("#95").
bool is_structure(const std::string& text) {
  if (text.front() != '#') return true;
  constexpr std::size_t kMaxDigits = 5;
  if (text.size() < 2 || text.size() > 1 + kMaxDigits || text[1] == '0') return false;
  int number = 0;
  for (const char c : text.substr(1)) {
    if (c < '0' || c > '9') return false;
    number = 10 * number + (c - '0');
  }
  return number <= 65535;
}

/// Reads a structure or a point; an invalid label number is an error.
std::optional<std::variant<std::string, Eigen::Vector3d>> read_position(const TableReader& reader,
                                                                        std::string_view key,
                                                                        Problems& problems) {
  auto position = reader.position(key);
  if (!position) return std::nullopt;
  const auto* name = std::get_if<std::string>(&*position);
  if (!name || is_structure(*name)) return position;
  problems.add(reader.line(key), std::string(key) + " = \"" + *name + "\" is not a label number",
               "a label number is written \"#1\" ... \"#65535\"");
  return std::nullopt;
}

ScriptStep read_approach(const TableReader& reader, Problems& problems) {
  ApproachStep step;
  if (const auto position = read_position(reader, "approach", problems)) {
    if (const auto* name = std::get_if<std::string>(&*position)) step.structure = *name;
    if (const auto* point = std::get_if<Eigen::Vector3d>(&*position)) step.point = Point<Patient>(*point);
  }
  if (const auto landmark = reader.choice("landmark"))
    step.landmark = Vector<Patient>(vector_of(*landmark, kPatientDirections));
  if (const auto position = read_position(reader, "nearest", problems)) {
    if (const auto* name = std::get_if<std::string>(&*position)) step.nearest = *name;
    if (const auto* point = std::get_if<Eigen::Vector3d>(&*position)) step.nearest = Point<Patient>(*point);
  }
  if (step.landmark && step.nearest.index() != 0)
    problems.add(reader.line("nearest"), "an approach with both landmark and nearest",
                 "keep only one of them");
  if (step.point && (step.landmark || step.nearest.index() != 0))
    problems.add(reader.line(step.landmark ? "landmark" : "nearest"),
                 "an approach to a point with a landmark or nearest", "name a structure: approach = \"...\"");
  if (const auto from = reader.direction("from"))
    step.from = Vector<Patient>(vector_of(*from, kPatientDirections)).normalized();
  step.speed_mm_s = reader.number("speed").value_or(step.speed_mm_s);
  step.clearance_mm = reader.number("clearance").value_or(step.clearance_mm);
  return step;
}

ScriptStep read_press(const TableReader& reader, Problems&) {
  PressStep step;
  step.force_N = reader.number("press").value_or(step.force_N);
  step.settle_s = reader.number("settle").value_or(step.settle_s);
  return step;
}

ScriptStep read_hold(const TableReader& reader, Problems&) {
  HoldStep step;
  step.seconds = reader.number("hold").value_or(step.seconds);
  return step;
}

ScriptStep read_slide(const TableReader& reader, Problems&) {
  SlideStep step;
  step.distance_mm = reader.number("slide").value_or(step.distance_mm);
  if (const auto direction = reader.direction("direction"))
    step.direction = Vector<Patient>(vector_of(*direction, kPatientDirections));
  step.speed_mm_s = reader.number("speed").value_or(step.speed_mm_s);
  return step;
}

ScriptStep read_mill(const TableReader& reader, Problems&) {
  MillStep step;
  if (const auto to = reader.point("mill")) step.to = Point<Patient>(*to);
  step.force_N = reader.number("force").value_or(step.force_N);
  step.speed_mm_s = reader.number("speed").value_or(step.speed_mm_s);
  return step;
}

ScriptStep read_rotate(const TableReader& reader, Problems&) {
  RotateStep step;
  step.degrees = reader.number("rotate").value_or(step.degrees);
  if (const auto axis = reader.direction("axis"))
    step.axis_world = vector_of(*axis, kWorldDirections).normalized();
  step.seconds = reader.number("seconds").value_or(step.seconds);
  return step;
}

ScriptStep read_method(const TableReader& reader, Problems&) {
  MethodStep step;
  if (const auto method = reader.choice("method")) step.method = *find_force_method(*method);
  return step;
}

ScriptStep read_motor(const TableReader& reader, Problems&) {
  return MotorStep{reader.flag("motor").value_or(true)};
}

ScriptStep read_stroke(const TableReader& reader, Problems&) {
  return StrokeStep{reader.choice("stroke") == "redo" ? StrokeAction::kRedo : StrokeAction::kUndo};
}

ScriptStep read_law(const TableReader& reader, Problems&) {
  LawStep step;
  if (const auto law = reader.choice("law")) step.law = value_of(*law, kTissueLaws);
  return step;
}

ScriptStep read_scope(const TableReader& reader, Problems& problems) {
  ScopeStep step;
  if (const auto at = reader.position("scope")) {
    const auto* name = std::get_if<std::string>(&*at);
    if (name && *name != "probe")
      problems.add(reader.line("scope"), "a scope cannot look at \"" + *name + "\"",
                   "write scope = \"probe\", or a point, [x, y, z] in LPS mm");
    if (const auto* point = std::get_if<Eigen::Vector3d>(&*at)) step.at = Point<Patient>(*point);
  }
  if (const auto from = reader.direction("from"))
    step.from = Vector<Patient>(vector_of(*from, kPatientDirections)).normalized();
  step.distance_mm = reader.number("distance").value_or(step.distance_mm);
  step.speed_mm_s = reader.number("speed").value_or(step.speed_mm_s);
  step.optics.lean_deg = reader.number("optics").value_or(step.optics.lean_deg);
  step.optics.back_mm = reader.number("back").value_or(step.optics.back_mm);
  return step;
}

ScriptStep read_leave(const TableReader& reader, Problems& problems) {
  LeaveStep step;
  if (!reader.flag("leave").value_or(true))
    problems.add(reader.line("leave"), "leave = false does nothing",
                 "write leave = true, or take the step out");
  step.speed_mm_s = reader.number("speed").value_or(step.speed_mm_s);
  return step;
}

using ReadStep = ScriptStep (*)(const TableReader&, Problems&);
// in the order of script_key_tables().actions
constexpr std::array<ReadStep, 12> kReadStep{read_approach, read_press,  read_hold,  read_slide,
                                             read_rotate,   read_method, read_leave, read_motor,
                                             read_stroke,   read_law,    read_scope, read_mill};

std::string action_names() {
  std::string names;
  for (const TableSpec& action : script_key_tables().actions)
    names += (names.empty() ? "" : ", ") + std::string(action.heading);
  return names;
}

/// Reports a step whose action is missing or mistyped.
void add_actionless(const TomlTable& table, Problems& problems) {
  std::vector<std::string_view> names;
  for (const TableSpec& action : script_key_tables().actions) names.push_back(action.heading);
  const std::string remedy = "a step has one of " + action_names();
  for (const auto& [key, value] : table.entries) {
    if (const std::string meant = did_you_mean(key, names); !meant.empty()) {
      problems.add(value.line, "unknown key \"" + key + "\" in [[step]]", meant + remedy);
      return;
    }
  }
  problems.add_missing(table.line, "a step without an action", remedy);
}

/// Index of the action of a [[step]], by its key. Exactly one action is required; otherwise an error is added
/// and the result is empty.
std::optional<std::size_t> find_action(const TomlTable& table, Problems& problems) {
  const auto& actions = script_key_tables().actions;
  std::optional<std::size_t> found;
  for (std::size_t i = 0; i < actions.size(); ++i) {
    const TomlValue* value = table.find(actions[i].heading);
    if (!value) continue;
    if (found) {
      problems.add(table.line,
                   "a step with two actions, " + std::string(actions[*found].heading) + " and " +
                       std::string(actions[i].heading),
                   "give each a [[step]] of its own");
      return std::nullopt;
    }
    found = i;
  }
  if (!found) add_actionless(table, problems);
  return found;
}

/// Checks that contact is made before it is used, and ended before the next approach.
void check_order(const Script& script, Problems& problems) {
  const auto& actions = script_key_tables().actions;
  const ApproachStep* touching = nullptr;
  int since = 0;
  for (std::size_t i = 0; i < script.steps.size(); ++i) {
    const ScriptStep& step = script.steps[i];
    if (const auto* approach = std::get_if<ApproachStep>(&step)) {
      if (touching) {
        problems.add(script.lines[i],
                     "approach while still touching " +
                         (touching->point ? "a point" : "\"" + touching->structure + "\"") + " (line " +
                         std::to_string(since) + ")",
                     "add a step with leave = true before it");
      }
      touching = approach;
      since = script.lines[i];
    } else if (needs_contact(step)) {
      if (!touching)
        problems.add(script.lines[i], std::string(actions[step.index()].heading) + " without contact",
                     "add a step with approach = \"...\" before it");
      if (std::holds_alternative<LeaveStep>(step)) touching = nullptr;
    }
  }
}

void read_steps(const TableReader& top, Script& script, Problems& problems) {
  const auto tables = top.tables("step");
  if (tables.empty()) {
    problems.add_missing(top.line("step"), "the script has no step",
                         "add a [[step]] with approach = \"...\"");
    return;
  }
  if (tables.size() > kMaxScriptSteps) {
    problems.add(tables[kMaxScriptSteps]->line,
                 std::to_string(tables.size()) + " steps, more than " + std::to_string(kMaxScriptSteps),
                 "split the script");
    return;
  }
  for (const TomlTable* table : tables) {
    const auto action = find_action(*table, problems);
    if (!action) continue;
    const TableReader reader(table, script_key_tables().actions[*action], problems);
    script.steps.push_back(kReadStep[*action](reader, problems));
    script.lines.push_back(table->line);
  }
}

}  // namespace

bool needs_contact(const ScriptStep& step) {
  return std::holds_alternative<PressStep>(step) || std::holds_alternative<HoldStep>(step) ||
         std::holds_alternative<SlideStep>(step) || std::holds_alternative<MillStep>(step) ||
         std::holds_alternative<LeaveStep>(step);
}

bool has_scope(const Script& script) {
  return std::ranges::any_of(script.steps,
                             [](const ScriptStep& step) { return std::holds_alternative<ScopeStep>(step); });
}

Result<Script> parse_script(std::string_view text, const std::string& source) {
  auto document = parse_toml(text, kMaxSceneBytes, source);
  if (!document) return document.error();

  const TomlValue* tissue = document->find("tissue");
  if (tissue && !document->find("step")) {
    return Error{ErrorKind::kBadInput, "this is a scene, not a palpation script",
                 source + ":" + std::to_string(tissue->line),
                 "give it before the script: palpate simulate SCENE --script SCRIPT"};
  }

  Problems problems(source);
  Script script;
  script.source = source;
  const TableReader top(&*document, script_key_tables().top, problems);
  script.title = top.text("title").value_or(script.title);
  script.device = top.text("device").value_or(script.device);
  script.hand = top.text("hand").value_or(script.hand);
  if (top.has("device")) script.device_line = top.line("device");
  if (top.has("hand")) script.hand_line = top.line("hand");
  script.rate_hz = top.number("rate").value_or(script.rate_hz);
  if (const auto delay_ms = top.number("delay")) script.delay_s = *delay_ms * 1e-3;
  script.tremor_mm = top.number("tremor").value_or(script.tremor_mm);
  if (const auto seed = top.integer("seed")) script.seed = static_cast<std::uint64_t>(*seed);
  read_steps(top, script, problems);
  if (!problems.any()) check_order(script, problems);
  if (problems.any()) return problems.first();
  return script;
}

Result<Script> load_script(const std::filesystem::path& file) {
  const auto text = read_file(file, kMaxSceneBytes);
  if (!text) return text.error();
  return parse_script(*text, file.string());
}

}  // namespace palpate
