#include "palpate/scene/task_file.h"

#include <algorithm>
#include <cmath>
#include <random>

#include "palpate/base/file.h"
#include "palpate/base/hash.h"
#include "scene/table_reader.h"
#include "scene/task_keys.h"

namespace palpate {
namespace {

/// Unit vector of a named direction or of a vector.
std::optional<Vector<Patient>> unit_direction(const TableReader& reader, std::string_view key) {
  const auto direction = reader.direction(key);
  if (!direction) return std::nullopt;
  const auto* vector = std::get_if<Eigen::Vector3d>(&*direction);
  return vector ? Vector<Patient>(*vector).normalized() : direction_named(std::get<std::string>(*direction));
}

void read_regions(const TableReader& top, TaskFile& task, Problems& problems) {
  for (const TomlTable* table : limited_tables(top, "region", kMaxTaskParts, "split the task", problems)) {
    const TableReader reader(table, task_key_tables().region, problems);
    TaskRegion region;
    region.line = table->line;
    region.name = required_name(reader, "a [[region]]", problems);
    region.structures = structures_of(reader, "a [[region]]", false, problems);
    if (const auto point = reader.point("point")) region.point = Point<Patient>(*point);
    if (const auto landmark = reader.choice("landmark")) region.landmark = direction_named(*landmark);
    region.radius_mm = reader.number("radius");
    if (const auto half = reader.choice("half")) region.half = direction_named(*half);
    if (const auto point = reader.point("plane_point")) region.plane_point = Point<Patient>(*point);
    region.plane_normal = unit_direction(reader, "plane_normal");
    if (reader.has("point") && reader.has("landmark"))
      problems.add(reader.line("landmark"), "a region with both point and landmark", "keep one of them");
    if ((reader.has("point") || reader.has("landmark")) != reader.has("radius"))
      problems.add(reader.line(),
                   "a region with " + std::string(reader.has("radius") ? "radius" : "a place") +
                       " and without " + (reader.has("radius") ? "a place" : "radius"),
                   "write point or landmark together with radius");
    if (reader.has("plane_point") != reader.has("plane_normal"))
      problems.add(reader.line(), "a region with half a plane",
                   "write plane_point together with plane_normal");
    if (!reader.has("structures") && (reader.has("landmark") || reader.has("half") || !reader.has("point")))
      problems.add(reader.line(), "a region needs structures, or a point and a radius",
                   "add structures, or write point and radius alone");
    if (std::any_of(task.regions.begin(), task.regions.end(), [&](const TaskRegion& other) {
          return !region.name.empty() && other.name == region.name;
        }))
      problems.add(reader.line("name"), "a second region \"" + region.name + "\"", "give it another name");
    task.regions.push_back(std::move(region));
  }
}

/// Index of the region that a step names: of the task's, or for kRemove of the plan's.
std::optional<std::size_t> region_of_step(const TableReader& reader, StepKind kind, const TaskFile& task,
                                          Problems& problems) {
  const bool of_plan = kind == StepKind::kRemove;
  const auto region = reader.text("region");
  if (!reader.has("region"))
    problems.add_missing(reader.line(), "a [[step]] without a region", "add region = \"...\"");
  if (!region || (of_plan && !task.plan)) return std::nullopt;
  std::vector<std::string_view> known;
  if (of_plan)
    for (const PlanRegion& each : task.plan->regions) known.push_back(each.name);
  else
    for (const TaskRegion& each : task.regions) known.push_back(each.name);
  const auto found = std::find(known.begin(), known.end(), *region);
  if (found != known.end()) return static_cast<std::size_t>(found - known.begin());
  problems.add(reader.line("region"),
               std::string(of_plan ? "the plan has no region \"" : "there is no region \"") + *region + "\"",
               did_you_mean(*region, known, "\"") +
                   (of_plan ? "add a [[region]] of that name to the plan" : "add a [[region]] of that name"));
  return std::nullopt;
}

StepKind kind_of_step(const TableReader& reader) {
  const std::string kind = reader.choice("kind").value_or("touch");
  return kind == "visit"    ? StepKind::kVisit
         : kind == "cover"  ? StepKind::kCover
         : kind == "remove" ? StepKind::kRemove
                            : StepKind::kTouch;
}

/// Checks that a step has no keys that its kind does not accept.
void check_step_keys(const TableReader& reader, const TaskStep& step, const TaskFile& task,
                     Problems& problems) {
  const bool touch = step.kind == StepKind::kTouch;
  const bool has_share = step.kind == StepKind::kCover || step.kind == StepKind::kRemove;
  if (reader.has("force") && !touch)
    problems.add(reader.line("force"), "force is only for a step with kind = \"touch\"",
                 "remove it, or write kind = \"touch\"");
  if (reader.has("coverage") && !has_share)
    problems.add(reader.line("coverage"), "coverage is only for a step with kind = \"cover\" or \"remove\"",
                 "remove it, or write kind = \"cover\" or kind = \"remove\"");
  if (reader.has("seconds") && has_share)
    problems.add(reader.line("seconds"), "seconds is not for a step with kind = \"cover\" or \"remove\"",
                 "remove it");
  if (reader.has("seen") && !touch)
    problems.add(reader.line("seen"), "seen is only for a step with kind = \"touch\"",
                 "remove it, or write kind = \"touch\"");
  if (step.seen && !task.scope)
    problems.add(reader.line("seen"), "a step has seen = true, but the task has no [scope]", "add [scope]");
  if (step.kind == StepKind::kRemove && !task.plan)
    problems.add(reader.line("kind"), "a step has kind = \"remove\", but the task has no plan",
                 "add plan = \"...\" at the top");
  if (step.kind == StepKind::kRemove || !reader.has("region") || step.region >= task.regions.size()) return;
  const bool ball = task.regions[step.region].structures.empty();
  if (ball != (step.kind == StepKind::kVisit))
    problems.add(reader.line("region"),
                 ball ? "a ball without structures cannot be touched" : "a surface cannot be visited",
                 ball ? "write kind = \"visit\", or give the region structures"
                      : "write kind = \"touch\", or name a region that is a ball");
}

void read_task_steps(const TableReader& top, TaskFile& task, Problems& problems) {
  for (const TomlTable* table : limited_tables(top, "step", kMaxTaskParts, "split the task", problems)) {
    const TableReader reader(table, task_key_tables().step, problems);
    TaskStep step;
    step.line = table->line;
    step.name = required_name(reader, "a [[step]]", problems);
    step.kind = kind_of_step(reader);
    const auto region = region_of_step(reader, step.kind, task, problems);
    step.region = region.value_or(0);
    if (const auto force = reader.interval("force")) step.force_N = *force;
    step.seconds = reader.number("seconds").value_or(step.seconds);
    step.coverage = reader.number("coverage").value_or(step.coverage);
    step.seen = reader.flag("seen").value_or(false);
    check_step_keys(reader, step, task, problems);
    task.steps.push_back(std::move(step));
  }
}

void read_forces(const TableReader& top, TaskFile& task, Problems& problems) {
  for (const TomlTable* table : limited_tables(top, "force", kMaxTaskParts, "split the task", problems)) {
    const TableReader reader(table, task_key_tables().force, problems);
    TaskForce force;
    force.line = table->line;
    force.structures = structures_of(reader, "a [[force]]", true, problems);
    force.band_N = reader.interval("band");
    force.limit_N = reader.number("limit");
    if (!reader.has("band") && !reader.has("limit"))
      problems.add_missing(reader.line(), "a [[force]] without band and limit", "add one of them");
    task.forces.push_back(std::move(force));
  }
  for (const TomlTable* table : limited_tables(top, "protected", kMaxTaskParts, "split the task", problems)) {
    const TableReader reader(table, task_key_tables().protection, problems);
    TaskProtected protection;
    protection.line = table->line;
    protection.structures = structures_of(reader, "a [[protected]]", true, problems);
    protection.limit_N = reader.number("limit").value_or(protection.limit_N);
    task.protections.push_back(std::move(protection));
  }
}

/// Part of the task file that a metric requires and the task lacks. Empty: none.
std::string missing_for(Metric metric, const TaskFile& task) {
  const auto any_force = [&](auto member) {
    return std::any_of(task.forces.begin(), task.forces.end(),
                       [&](const TaskForce& force) { return (force.*member).has_value(); });
  };
  switch (metric) {
    case Metric::kForceInBand:
    case Metric::kLongestInBand:
      return any_force(&TaskForce::band_N) ? "" : "a [[force]] with a band";
    case Metric::kExcessImpulse:
      return any_force(&TaskForce::limit_N) ? "" : "a [[force]] with a limit";
    case Metric::kCoverage:
      return std::any_of(task.steps.begin(), task.steps.end(),
                         [](const TaskStep& step) { return step.kind == StepKind::kCover; })
                 ? ""
                 : "a [[step]] with kind = \"cover\"";
    case Metric::kProtectedTime:
      return task.protections.empty() ? "a [[protected]]" : "";
    case Metric::kStepsDone:
      return task.steps.empty() ? "a [[step]]" : "";
    case Metric::kAnswerError:
      return task.answer ? "" : "an [answer]";
    case Metric::kUnseenTime:
      return task.scope ? "" : "a [scope]";
    case Metric::kRemovedInPlan:
    case Metric::kRemovedOutside:
    case Metric::kDepthPastPlan:
      return task.plan ? "" : "a plan";
    case Metric::kProtectedRemoved:
      return !task.plan ? "a plan" : task.protections.empty() ? "a [[protected]]" : "";
    case Metric::kBoneLeft:
    case Metric::kBurrDistance:
    case Metric::kForceNear:
      return task.plan ? "" : "a plan";
    case Metric::kHiddenTime:
      return !task.plan ? "a plan" : task.microscope ? "" : "a [microscope]";
    default:
      return "";
  }
}

void read_metrics(const TableReader& top, TaskFile& task, Problems& problems) {
  const auto tables = limited_tables(top, "metric", kMaxTaskParts, "split the task", problems);
  if (tables.empty() && !top.has("metric"))
    problems.add_missing(top.line("metric"), "the task has no metric",
                         "add a [[metric]] with name = \"...\"");
  for (const TomlTable* table : tables) {
    const TableReader reader(table, task_key_tables().metric, problems);
    TaskMetric metric;
    metric.line = table->line;
    const auto name = reader.choice("name");
    if (!reader.has("name"))
      problems.add_missing(reader.line(), "a [[metric]] without a name", "add name = \"...\"");
    metric.structures = structures_of(reader, "a [[metric]]", false, problems);
    metric.within_mm = reader.number("within").value_or(metric.within_mm);
    metric.at_least = reader.number("at_least");
    metric.at_most = reader.number("at_most");
    metric.basis = reader.text("basis").value_or("");
    if (metric.at_least && metric.at_most && *metric.at_least > *metric.at_most)
      problems.add(reader.line("at_most"), "at_most below at_least", "no value is in between");
    if (name) {
      const auto& infos = metric_infos();
      const auto found = std::find_if(infos.begin(), infos.end(),
                                      [&](const MetricInfo& info) { return info.name == *name; });
      metric.metric = found->metric;
      if (reader.has("structures") && !found->of_structures)
        problems.add(reader.line("structures"), *name + " is not of single structures", "remove structures");
      if (!reader.has("structures") && found->needs_structures)
        problems.add_missing(reader.line("name"), *name + " without structures",
                             "add structures = [\"...\"]");
      if (reader.has("within") && metric.metric != Metric::kForceNear)
        problems.add(reader.line("within"), "within is only for force_near", "remove it");
      if (const std::string missing = missing_for(metric.metric, task); !missing.empty())
        problems.add(reader.line("name"), *name + " of a task without " + missing, "add " + missing);
    }
    task.metrics.push_back(std::move(metric));
  }
}

/// Reads the plan that the task names.
void read_plan_of_task(const TableReader& top, const std::optional<std::filesystem::path>& beside,
                       TaskFile& task, Problems& problems) {
  const auto name = top.text("plan");
  if (!name) return;
  const int line = top.line("plan");
  if (!beside && !find_file(embedded_plans(), *name + ".toml"))
    return problems.add(line, "palpate includes no plan \"" + *name + "\"", "name another one");
  auto plan = load_plan(*name, beside.value_or(""));
  if (!plan)
    return problems.add(
        line, "the plan \"" + *name + "\" cannot be used: " + plan.error().where + ": " + plan.error().what,
        plan.error().remedy);
  if (plan->regions.empty())
    return problems.add(line, "the plan \"" + *name + "\" removes nothing", "add a [[region]] to it");
  hash_word(task.text_hash, plan->text_hash);
  task.plan = *std::move(plan);
}

bool is_word_of_data_set(const std::string& word) {
  return !word.empty() && word.size() <= 60 && std::all_of(word.begin(), word.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-' || c == '_';
  });
}

bool is_key_of_data_set(const std::string& key) {
  return !key.empty() && key.size() <= 40 &&
         std::all_of(key.begin(), key.end(), [](char c) { return (c >= 'a' && c <= 'z') || c == '-'; });
}

void read_draws(const TableReader& top, TaskFile& task, Problems& problems) {
  for (const TomlTable* table : limited_tables(top, "drawn", kMaxTaskParts, "split the task", problems)) {
    const TableReader reader(table, task_key_tables().drawn, problems);
    TaskDraw draw;
    const auto key = reader.text("key");
    const auto range = reader.interval("range");
    draw.step = reader.number("step").value_or(draw.step);
    if (auto words = reader.names("words")) draw.words = *std::move(words);
    if (!reader.has("key") || !(reader.has("range") || reader.has("words")))
      problems.add_missing(reader.line(), "a [[drawn]] without key and range", "add both");
    if (reader.has("words") && (reader.has("range") || reader.has("step")))
      problems.add(reader.line("words"), "a [[drawn]] has both words and numbers",
                   "keep words, or range and step");
    for (const std::string& word : draw.words)
      if (!is_word_of_data_set(word))
        problems.add(reader.line("words"), "\"" + word + "\" is not a valid word",
                     "use small letters, digits, - and _");
    if (key && !is_key_of_data_set(*key))
      problems.add(reader.line("key"), "\"" + *key + "\" is not a key of a data set",
                   "palpate data keys lists them; small letters and -");
    if (key && *key == "seed")
      problems.add(reader.line("key"), "the seed itself cannot be drawn", "remove this [[drawn]]");
    if (key) draw.key = *key;
    if (range) draw.range = *range;
    if (top.has("data_set") == false)
      problems.add(reader.line(), "the task has a [[drawn]] but no data_set",
                   "add data_set = \"...\" at the top");
    task.draws.push_back(std::move(draw));
  }
}

}  // namespace

Result<TaskFile> parse_task(std::string_view text, const std::string& source,
                            const std::optional<std::filesystem::path>& beside) {
  const auto document = parse_toml(text, kMaxSceneBytes, source);
  if (!document) return document.error();
  if (document->find("tissue") && !document->find("metric"))
    return Error{ErrorKind::kBadInput, "this is a scene, not a task",
                 source + ":" + std::to_string(document->find("tissue")->line),
                 "docs/guide/tasks.md describes tasks"};

  Problems problems(source);
  TaskFile task;
  task.source = source;
  hash_bytes(task.text_hash = kHashSeed, text.data(), text.size());
  const TableReader top(&*document, task_key_tables().top, problems);
  task.title = top.text("title").value_or("");
  if (!top.has("title")) problems.add_missing(1, "the task has no title", "add title = \"...\" at the top");
  task.briefing = top.text("briefing").value_or("");
  task.data_set = top.text("data_set").value_or("");
  task.ordered = top.flag("ordered").value_or(false);
  task.quiz = top.flag("quiz").value_or(false);
  if (top.choice("end") == "recording") task.end = TaskEnd::kRecording;
  task.time_limit_s = top.number("time_limit");
  if (const auto runs = top.integer("in_a_row")) task.in_a_row = static_cast<int>(*runs);
  if (const TomlTable* table = top.table("scope")) {
    const TableReader reader(table, task_key_tables().scope, problems);
    task.scope.emplace();
    task.scope->line = table->line;
    task.scope->optics.lean_deg = reader.number("optics").value_or(task.scope->optics.lean_deg);
    task.scope->optics.back_mm = reader.number("back").value_or(task.scope->optics.back_mm);
  }
  if (const TomlTable* table = top.table("microscope")) {
    const TableReader reader(table, task_key_tables().microscope, problems);
    task.microscope.emplace();
    task.microscope->line = table->line;
    task.microscope->from = unit_direction(reader, "from").value_or(task.microscope->from);
    task.microscope->tilt_deg = reader.number("tilt").value_or(task.microscope->tilt_deg);
  }
  read_plan_of_task(top, beside, task, problems);
  task.text_hash = hash_finish(task.text_hash);
  read_regions(top, task, problems);
  read_task_steps(top, task, problems);
  read_forces(top, task, problems);
  if (const TomlTable* table = top.table("answer")) {
    const TableReader reader(table, task_key_tables().answer, problems);
    task.answer.emplace();
    task.answer->line = table->line;
    task.answer->structures = structures_of(reader, "[answer]", true, problems);
    task.answer->seconds = reader.number("seconds").value_or(task.answer->seconds);
  }
  read_metrics(top, task, problems);
  read_draws(top, task, problems);
  if (task.steps.empty() && task.end == TaskEnd::kSteps && !top.has("step") && top.has("metric"))
    problems.add_missing(top.line("end"), "the task ends with its steps, but has none",
                         "add a [[step]], or write end = \"recording\"");
  if (problems.any()) return problems.first();
  return task;
}

Result<TaskFile> load_task(const std::string& name_or_file) {
  if (const EmbeddedFile* file = find_file(embedded_tasks(), name_or_file + ".toml"))
    return parse_task(file->text, name_or_file + ".toml");
  auto text = read_file(name_or_file, kMaxSceneBytes);
  if (!text) {
    Error error = text.error();
    error.remedy = "give a task file, or the name of a task from palpate task list";
    return error;
  }
  return parse_task(*text, name_or_file, std::filesystem::path(name_or_file).parent_path());
}

std::string drawn_data_set(const TaskFile& task, std::uint64_t seed) {
  const bool has_positions =
      task.plan && !(task.plan->trajectories.empty() &&
                     std::ranges::all_of(task.plan->regions, [](const PlanRegion& region) {
                       return region.shape == PlanShape::kStructures;
                     }));
  if (task.data_set.empty() || has_positions) return task.data_set;
  const bool has_parameters = task.data_set.find(':') != std::string::npos;
  std::string text = task.data_set + (has_parameters ? "," : ":") + "seed=" + std::to_string(seed);
  std::mt19937_64 random(seed * 0x9e3779b97f4a7c15ull + 1);
  for (const TaskDraw& draw : task.draws) {
    if (!draw.words.empty()) {
      text += "," + draw.key + "=" + draw.words[random() % draw.words.size()];
      continue;
    }
    const double largest = std::floor((draw.range[1] - draw.range[0]) / draw.step + 1e-9);
    const auto steps = static_cast<std::uint64_t>(std::clamp(largest, 0.0, 1e9)) + 1;
    // the modulo bias is negligible for so few values, and the result is the same on every platform
    const double value = draw.range[0] + draw.step * static_cast<double>(random() % steps);
    // rounded to 1e-6 to remove binary representation errors
    text += "," + draw.key + "=" + number_text(std::round(value * 1e6) / 1e6);
  }
  return text;
}

}  // namespace palpate
