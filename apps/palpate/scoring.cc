#include "scoring.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "apps/command/text.h"
#include "palpate/base/printable.h"
#include "palpate/base/utc.h"
#include "palpate/json/json.h"
#include "palpate/loading/loading.h"
#include "palpate/palpation/recorded_model.h"
#include "palpate/phantoms/phantoms.h"

namespace palpate::app {
namespace {

std::string hexadecimal(std::uint64_t hash) {
  char text[17];
  std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(hash));
  return text;
}

// seed in the name of a data set
std::uint64_t seed_in(const std::string& data_set) {
  constexpr std::string_view kKey = "seed=";
  for (std::size_t at = data_set.find(kKey); at != std::string::npos; at = data_set.find(kKey, at + 1))
    if (at > 0 && (data_set[at - 1] == ':' || data_set[at - 1] == ','))
      return std::strtoull(data_set.c_str() + at + kKey.size(), nullptr, 10);
  return 0;
}

// canonical name in the catalogue, independent of the order of parameters
std::string canonical_name(const std::string& data_set) {
  const auto phantom =
      is_phantom_name(data_set) ? parse_phantom(data_set) : Result<PhantomParameters>(Error{});
  return phantom ? phantom_name(*phantom) : data_set;
}

// whether a task is built in, by its name and text hash
bool is_built_in_task(const std::string& name, std::uint64_t hash) {
  const EmbeddedFile* file = find_file(embedded_tasks(), name + ".toml");
  if (file == nullptr) return false;
  const auto task = parse_task(file->text, name);
  return task.ok() && task->text_hash == hash;
}

}  // namespace

RecordedTask recorded_task(const OfferedTask& task, const std::string& data_set) {
  const TaskFile& file = task.file;
  // the name of a file may identify a patient and is not stored
  RecordedTask recorded{
      is_built_in_task(task.name, file.text_hash) ? task.name : file.title, file.text_hash, {}};
  const std::uint64_t seed = seed_in(data_set);
  if (!file.draws.empty() && canonical_name(drawn_data_set(file, seed)) == canonical_name(data_set))
    recorded.seed = std::to_string(seed);
  return recorded;
}

Result<OfferedTask> task_of_recording(const RecordingHeader& header, const std::string& requested,
                                      const std::filesystem::path& recording, Console& console) {
  const RecordedTask& recorded = header.task;
  if (!requested.empty()) {
    auto task = offered_task(requested);
    if (task && !recorded.name.empty() && task->file.text_hash != recorded.hash)
      console.warn()(recording.string() + " states that it is a run of \"" + printable_name(recorded.name) +
                     "\" in a version of the text other than " + printable_name(requested) +
                     ", which is used here to score it");
    return task;
  }
  if (recorded.name.empty())
    return Error{ErrorKind::kUsage, "the recording does not state which task it is a run of",
                 recording.string(), "name the task: --task"};
  if (!is_built_in_task(recorded.name, recorded.hash))
    return Error{ErrorKind::kUsage,
                 "the recording is a run of \"" + printable_name(recorded.name) +
                     "\", and this palpate does not include that version of the task",
                 recording.string(), "name its file: --task"};
  return offered_task(recorded.name);
}

bool is_run_of_task(const RecordingHeader& header, const std::string& requested, const TickRange& ticks) {
  const bool has_ticks = ticks.first != TickRange{}.first || ticks.last != TickRange{}.last;
  if (!requested.empty() || has_ticks) return true;
  return header.simulated && is_built_in_task(header.task.name, header.task.hash);
}

Result<OfferedTask> offered_task(const std::string& name_or_file) {
  auto task = load_task(name_or_file);
  if (!task) return task.error();
  // the name of a file may identify a patient, and viewers receive the name of the task
  const std::string name = std::filesystem::path(name_or_file).stem().string();
  return OfferedTask{is_built_in_task(name, task->text_hash) ? name : "task", *std::move(task)};
}

Result<TaskInScene> resolve_for_score(const TaskFile& task, std::shared_ptr<const Model> model,
                                      const Progress& progress) {
  const bool covers = std::any_of(task.steps.begin(), task.steps.end(),
                                  [](const TaskStep& step) { return step.kind == StepKind::kCover; });
  if (covers) {
    constexpr std::array kProxyAlone = {ForceMethod::kProxy};
    auto ready = prepared_with_cache(std::move(model), kProxyAlone, progress);
    if (!ready) return ready.error();
    model = *std::move(ready);
  }
  return resolve_task(task, *model, progress);
}

void add_tick_options(CLI::App& verb, TickRange& ticks) {
  verb.add_option("--from-tick", ticks.first, "First tick of the run, if it began during the recording")
      ->check(whole_between(0, 1ull << 62));
  verb.add_option("--to-tick", ticks.last, "Last tick of the run")->check(whole_between(0, 1ull << 62));
}

Error ticks_in_reverse() {
  return {ErrorKind::kUsage, "is after --to-tick", "--from-tick", "give the earlier one first"};
}

Json number_or_null(double value) {
  return std::isnan(value) ? Json(nullptr) : Json(value);
}

Json number_or_null(const std::optional<double>& value) {
  return value ? Json(*value) : Json(nullptr);
}

Result<ScoredRun> Scorer::score(const std::filesystem::path& recording, Console& console) {
  const Progress progress = console.progress();
  const auto source = RecordingSource::open(recording, progress);
  if (!source) return source.error();
  const auto named = [&](Error error) {
    if (error.where.empty()) error.where = recording.string();
    return error;
  };
  const RecordingHeader& header = source->head().header;
  if (!model_ || loaded_ != header.data_set) {
    const auto loaded = load_scene_of_recording(header, source_, progress, console.warn());
    if (!loaded) return loaded.error();
    model_ = loaded->model;
    loaded_ = header.data_set;
    auto in_scene = resolve_for_score(task_, model_, progress);
    if (!in_scene) return in_scene.error();
    in_scene_ = *std::move(in_scene);
  }
  if (const auto same = check_recorded_model(header, *model_); !same) return named(same.error());
  auto scored = score_recording(*in_scene_, *source, progress, ticks_);
  if (!scored) return named(scored.error());
  const auto& summary = source->head().summary;
  return ScoredRun{recording, header, *std::move(scored), summary ? summary->run_hash : 0};
}

void print_score(const TaskFile& task, const TaskScore& score, const std::string& name) {
  std::printf("%s: %s\n", name.c_str(), task.title.c_str());
  for (const MetricValue& value : score.metrics) {
    const TaskMetric& metric = task.metrics[value.part];
    const char* verdict = !value.counts ? "" : value.in_band ? "in band" : "OUT OF BAND";
    std::printf("  %s  %s  %s  %s%s\n",
                pad_or_truncate(readable_metric_name(metric_name(metric)), 36).c_str(),
                pad_or_truncate(metric_text(value.metric, value.value), 12).c_str(),
                pad_or_truncate(bounds_text(metric), 16).c_str(), verdict,
                value.counts && metric.basis.empty() ? " (not validated)" : "");
  }
  for (const TaskEvent& event : score.events)
    std::printf("  %9.3f s  %s\n", event.time_s, event_text(task, event).c_str());
  if (score.more_events > 0)
    std::printf("  and %llu more\n", static_cast<unsigned long long>(score.more_events));
  for (std::size_t n = 0; n < task.steps.size(); ++n)
    if (!score.done[n]) std::printf("  not done: %s\n", task.steps[n].name.c_str());
  if (score.cut_short) std::printf("  the recording was cut short: no pass\n");
  if (score.missing_s > 0)
    std::printf("  %.3f s are missing because ticks were dropped: no pass\n", score.missing_s);
}

Json json_of(const TaskFile& task, const ScoredRun& run) {
  const TaskScore& score = run.score;
  Json json;
  json["task"] = task.title;
  json["task_hash"] = hexadecimal(task.text_hash);
  json["recording"] = run.recording.filename().string();
  json["data_set"] = run.header.data_set;
  json["started_utc"] = utc_after(run.header.started_utc, score.started_s);
  json["palpate_version"] = run.header.palpate_version;
  json["ticks"] = score.ticks;
  json["missing_s"] = score.missing_s;
  json["ended"] = score.ended;
  json["cut_short"] = score.cut_short;
  json["in_band"] = score.in_band;
  json["score_hash"] = hexadecimal(score.hash);
  json["metrics"] = Json::array();
  for (const MetricValue& value : score.metrics) {
    const TaskMetric& metric = task.metrics[value.part];
    const MetricInfo& info = info_of(value.metric);
    json["metrics"].push_back({{"name", metric_name(metric)},
                               {"title", readable_metric_name(metric_name(metric))},
                               {"value", number_or_null(value.value)},
                               {"unit", info.unit},
                               {"counts", value.counts},
                               {"at_least", number_or_null(metric.at_least)},
                               {"at_most", number_or_null(metric.at_most)},
                               {"in_band", value.counts ? Json(value.in_band) : nullptr},
                               {"basis", metric.basis.empty() ? "not validated" : metric.basis},
                               {"validity", info.validity}});
  }
  json["steps"] = Json::array();
  for (std::size_t n = 0; n < task.steps.size(); ++n)
    json["steps"].push_back({{"name", task.steps[n].name}, {"done", static_cast<bool>(score.done[n])}});
  json["events"] = Json::array();
  for (const TaskEvent& event : score.events)
    json["events"].push_back({{"kind", kind_name(event.kind)},
                              {"tick", event.tick},
                              {"time_s", event.time_s},
                              {"force_N", event.force_N},
                              {"text", event_text(task, event)}});
  json["more_events"] = score.more_events;
  return json;
}

}  // namespace palpate::app
