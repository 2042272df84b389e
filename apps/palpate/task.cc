#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>

#include "apps/command/text.h"
#include "palpate/base/printable.h"
#include "palpate/json/json.h"
#include "palpate/tasks/calibration.h"
#include "recorded_runs.h"
#include "scoring.h"
#include "verb.h"

namespace palpate::app {
namespace {

struct TaskOptions {
  std::vector<std::filesystem::path> recordings, novices;
  SceneSource source;
  std::string task, learner;
  std::filesystem::path records;
  bool json = false;
  double fraction = 0.9;
  std::uint64_t seed = 1;
  TickRange ticks;
};

// task by which all recordings are scored: the requested one, otherwise the one that they name
Result<TaskFile> task_of_runs(const TaskOptions& options, Console& console) {
  std::optional<TaskFile> task;
  for (const auto& recording : options.recordings) {
    const auto source = RecordingSource::open(recording, console.progress());
    if (!source) return source.error();
    auto its = task_of_recording(source->head().header, options.task, recording, console);
    if (!its) return its.error();
    if (task && task->text_hash != its->file.text_hash)
      return Error{ErrorKind::kUsage, "is a run of another task than the recordings before it",
                   recording.string(),
                   "score the recordings of one task at a time, or give the task: --task"};
    task = std::move(its->file);
  }
  return *std::move(task);
}

int score_runs(const TaskOptions& options, Console& console) {
  if (options.ticks.first > options.ticks.last) return console.fail(ticks_in_reverse());
  auto task = task_of_runs(options, console);
  if (!task) return console.fail(task.error());
  Scorer scorer(*std::move(task), options.source, options.ticks);
  std::vector<ScoredRun> runs;
  std::vector<bool> in_band;
  for (const auto& recording : options.recordings) {
    auto run = scorer.score(recording, console);
    if (!run) return console.fail(run.error());
    in_band.push_back(run->score.in_band);
    runs.push_back(*std::move(run));
  }
  for (const ScoredRun& run : options.learner.empty() ? std::vector<ScoredRun>() : runs) {
    const auto id = record_run(options.records, options.learner, scorer.task(), run, console);
    if (!id) return console.fail(id.error());
    console.note("run " + std::to_string(*id) + " of " + printable_name(options.learner) +
                 " is in the records");
  }
  const int in_a_row = runs_in_a_row(in_band);
  const bool passed = in_a_row >= scorer.task().in_a_row;
  if (options.json) {
    Json json;
    json["runs"] = Json::array();
    for (const ScoredRun& run : runs) json["runs"].push_back(json_of(scorer.task(), run));
    json["in_a_row"] = in_a_row;
    json["in_a_row_asked"] = scorer.task().in_a_row;
    json["passed"] = passed;
    std::printf("%s\n", json.dump(2).c_str());
  } else {
    for (const ScoredRun& run : runs)
      print_score(scorer.task(), run.score, run.recording.filename().string());
    std::printf("%s: %d of %d runs in a row with every counted metric in its band\n",
                passed ? "PASSED" : "not passed yet", in_a_row, scorer.task().in_a_row);
  }
  return runs.back().score.in_band ? kExitOk : kExitLimit;
}

int calibrate(const TaskOptions& options, Console& console) {
  auto task = load_task(options.task);
  if (!task) return console.fail(task.error());
  Scorer scorer(*std::move(task), options.source);
  const auto values_of =
      [&](const std::vector<std::filesystem::path>& recordings) -> Result<std::vector<std::vector<double>>> {
    std::vector<std::vector<double>> values(scorer.task().metrics.size());
    for (const auto& recording : recordings) {
      const auto run = scorer.score(recording, console);
      if (!run) return run.error();
      if (run->score.cut_short)
        console.warn()(recording.string() + " was cut short and is scored up to its end");
      for (const MetricValue& value : run->score.metrics) values[value.part].push_back(value.value);
    }
    return values;
  };
  const auto experts = values_of(options.recordings);
  if (!experts) return console.fail(experts.error());
  const auto novices = values_of(options.novices);
  if (!novices) return console.fail(novices.error());

  Json json;
  json["task"] = scorer.task().title;
  json["expert_runs"] = options.recordings.size();
  json["novice_runs"] = options.novices.size();
  json["cut_offs"] = Json::array();
  if (!options.json)
    std::printf(
        "# %s: cut-offs from %zu experts' runs%s. If runs of one person are among them, they are not "
        "independent\n"
        "# and the interval is too narrow. Copy the tables into the task file.\n",
        scorer.task().title.c_str(), options.recordings.size(),
        options.novices.empty() ? ""
                                : (" and " + std::to_string(options.novices.size()) + " novices'").c_str());
  for (std::size_t n = 0; n < scorer.task().metrics.size(); ++n) {
    const TaskMetric& metric = scorer.task().metrics[n];
    const MetricInfo& info = info_of(metric.metric);
    CalibrationOptions how;
    how.fraction = options.fraction;
    how.seed = options.seed;
    const auto found = cut_off((*experts)[n], (*novices)[n], info.more_is_better, how);
    Json row{{"name", metric_name(metric)}, {"unit", info.unit}};
    const double area = area_under_curve((*experts)[n], (*novices)[n], info.more_is_better);
    if (!found) {
      row["none"] = found.error().what;
      if (!options.json)
        std::printf("\n# %s: none; %s (%s)\n", metric_name(metric).c_str(), found.error().what.c_str(),
                    found.error().remedy.c_str());
    } else {
      const std::string basis =
          (found->has_enough_runs ? "" : "not validated, too few runs: ") + found->method + ", " +
          std::to_string(options.recordings.size()) + " experts' runs" +
          (options.novices.empty() ? "" : ", " + std::to_string(options.novices.size()) + " novices'");
      const char* key = info.more_is_better ? "at_least" : "at_most";
      row[key] = found->value;
      row["interval"] = found->interval;
      row["method"] = found->method;
      row["is_enough"] = found->has_enough_runs;
      if (found->experts_below) row["experts_that_fail"] = *found->experts_below;
      if (found->novices_above) row["novices_that_pass"] = *found->novices_above;
      if (!options.novices.empty()) row["area_under_curve"] = area;
      if (!options.json) {
        std::printf("\n[[metric]]\nname = \"%s\"\n", std::string(info.name).c_str());
        if (!metric.structures.empty()) {
          std::string list;
          for (const LabelReference& structure : metric.structures) {
            const auto* number = std::get_if<int>(&structure);
            list += (list.empty() ? "" : ", ") +
                    (number ? std::to_string(*number) : Json(std::get<std::string>(structure)).dump());
          }
          std::printf("structures = [%s]\n", list.c_str());
        }
        std::printf("%s = %.6g  # 95 %%: %.6g ... %.6g %s", key, found->value, found->interval[0],
                    found->interval[1], info.unit == "1" ? "" : std::string(info.unit).c_str());
        if (found->experts_below)
          std::printf("; %.0f %% of experts' runs fail, %.0f %% of novices' pass; area under the curve %.2f",
                      100 * *found->experts_below, 100 * *found->novices_above, area);
        std::printf("\nbasis = \"%s\"\n", basis.c_str());
      }
    }
    json["cut_offs"].push_back(row);
  }
  if (options.json) std::printf("%s\n", json.dump(2).c_str());
  return kExitOk;
}

int list_tasks(const TaskOptions& options, Console&) {
  Json json = Json::array();
  for (const EmbeddedFile& file : embedded_tasks()) {
    const auto task = parse_task(file.text, std::string(file.name));
    PALPATE_CHECK(task.ok());
    const std::string name(file.name.substr(0, file.name.size() - std::string_view(".toml").size()));
    if (options.json) {
      json.push_back({{"name", name},
                      {"title", task->title},
                      {"data_set", task->data_set},
                      {"briefing", task->briefing}});
    } else {
      std::printf("%s  %s  %s\n", pad_or_truncate(name, 22).c_str(),
                  pad_or_truncate(task->data_set, 26).c_str(), task->title.c_str());
    }
  }
  if (options.json) std::printf("%s\n", json.dump(2).c_str());
  return kExitOk;
}

int show_task(const TaskOptions& options, Console& console) {
  if (const EmbeddedFile* file = find_file(embedded_tasks(), options.task + ".toml"))
    return print_result(std::string(file->text));
  const auto task = load_task(options.task);
  if (!task) return console.fail(task.error());
  std::printf("%s\n%s\n", task->title.c_str(), task->briefing.c_str());
  return kExitOk;
}

int draw(const TaskOptions& options, Console& console) {
  const auto task = load_task(options.task);
  if (!task) return console.fail(task.error());
  const std::string drawn = drawn_data_set(*task, options.seed);
  if (drawn.empty())
    return console.fail({ErrorKind::kBadInput, "the task names no data set", task->source,
                         "add data_set = \"...\", or give its scene"});
  std::printf("%s\n", drawn.c_str());
  return kExitOk;
}

CLI::Option* add_task_option(CLI::App& verb, TaskOptions& options, const std::string& help) {
  CLI::Option* task = verb.add_option("-t,--task", options.task, help);
  verb.add_option("--scene", options.source.target,
                  "Scene file or volume of the recordings; not needed for data sets");
  return task;
}

}  // namespace

void add_task(CLI::App& app, Run& run) {
  auto options = std::make_shared<TaskOptions>();
  CLI::App* verb = app.add_subcommand("task", "Training: list, show and draw tasks, and score runs");
  verb->require_subcommand(1);
  const auto when = [&run, options](CLI::App* sub, int (*what)(const TaskOptions&, Console&)) {
    sub->callback([options, &run, what] {
      run = [options, what](Console& console) { return what(*options, console); };
    });
  };

  CLI::App* list = verb->add_subcommand("list", "List the tasks included with palpate");
  list->add_flag("--json", options->json, "Print JSON, with the briefings");
  when(list, list_tasks);

  CLI::App* show = verb->add_subcommand("show", "Print the file of a task, to read or to adapt");
  show->add_option("task", options->task, "Name of a task (palpate task list), or a file")->required();
  when(show, show_task);

  verb->add_subcommand("keys", "Print every key of a task file as Markdown tables")->callback([&run] {
    run = [](Console&) { return print_result(task_keys()); };
  });

  CLI::App* drawn =
      verb->add_subcommand("draw", "Print the data set of a task with the parameters drawn by a seed");
  drawn->add_option("task", options->task, "Task file, or the name of a task (palpate task list)")
      ->required();
  drawn->add_option("--seed", options->seed, "Seed; default: 1")->check(whole_between(0, 1000000000));
  drawn->footer("Example: palpate explore \"$(palpate task draw find-the-nodule --seed 7)\" -o run.h5");
  when(drawn, draw);

  CLI::App* score = verb->add_subcommand("score", "Score recordings by a task");
  score
      ->add_option("recordings", options->recordings,
                   "Recordings made by palpate simulate or explore, in chronological order")
      ->required();
  add_task_option(
      *score, *options,
      "Task file, or the name of a task (palpate task list); default: the task named in the recordings");
  CLI::Option* record =
      score->add_option("--record", options->learner, "Pseudonym of the learner to record the scores for");
  score->add_option("--records", options->records, "File of training records (palpate records --help)")
      ->needs(record);
  add_tick_options(*score, options->ticks);
  score->add_flag("--json", options->json, "Print JSON, with every event");
  score->footer(
      "Examples:\n"
      "  palpate task score run.h5\n"
      "  palpate task score run.h5 --task meniscus-probing --record L042\n"
      "  palpate task score monday.h5 tuesday.h5 friday.h5 --task my-task.toml --json\n"
      "  palpate task score run.h5 --task hold-steady --from-tick 5120 --to-tick 20833\n\n"
      "A pass requires the number of consecutive runs that the task sets, each with every counted metric in "
      "its\n"
      "band. Exit code 3: a metric of the last run is out of its band. docs/reference/metrics.md defines "
      "each\n"
      "metric and the evidence for its validity: for most, there is none yet.");
  when(score, score_runs);

  CLI::App* calibration =
      verb->add_subcommand("calibrate", "Compute cut-offs for the metrics of a task from experts' runs");
  calibration->add_option("recordings", options->recordings, "Recordings of experts")->required();
  add_task_option(*calibration, *options, "Task file, or the name of a task (palpate task list)")->required();
  calibration->add_option("--novices", options->novices,
                          "Recordings of novices: cut-offs by contrasting groups");
  calibration
      ->add_option("--share", options->fraction,
                   "Share of experts' runs that pass, without novices; default: 0.9")
      ->check(number_between(0.5, 0.99));
  calibration->add_flag("--json", options->json, "Print JSON instead of text");
  calibration->footer(
      "Examples:\n"
      "  palpate task calibrate expert-*.h5 --task meniscus-probing\n"
      "  palpate task calibrate expert-*.h5 --novices novice-*.h5 --task meniscus-probing\n\n"
      "Prints [[metric]] tables for the task file, with 95 % intervals by bootstrap. Fewer than 10 runs of a "
      "group:\n"
      "\"not validated\". docs/guide/tasks.md describes the method.");
  when(calibration, calibrate);
}

}  // namespace palpate::app
