#include "palpate/report/report.h"

#include <memory>

#include "input_files.h"
#include "palpate/base/output.h"
#include "palpate/loading/loading.h"
#include "plan_comparison.h"
#include "report_model.h"
#include "scene_options.h"
#include "scoring.h"
#include "verb.h"

namespace palpate::app {
namespace {

struct ReportOptions {
  std::filesystem::path recording, output, plan;
  SceneSource source;
  std::string task;
  TickRange ticks;
  int device = 1;
};

int report_recording(const ReportOptions& options, Console& console) {
  std::filesystem::path output = options.output;
  if (output.empty()) output = std::filesystem::path(options.recording).replace_extension(".html");
  const Progress progress = console.progress();
  std::optional<PlanFile> plan;
  if (!options.plan.empty()) {
    auto read = load_plan(options.plan);
    if (!read) return console.fail(read.error());
    plan = *std::move(read);
  }
  if (options.ticks.first > options.ticks.last) return console.fail(ticks_in_reverse());
  const auto recording = RecordingSource::open(options.recording, progress);
  if (!recording) return console.fail(recording.error());
  std::optional<OfferedTask> task;
  if (is_run_of_task(recording->head().header, options.task, options.ticks)) {
    auto offered = task_of_recording(recording->head().header, options.task, options.recording, console);
    if (!offered) return console.fail(offered.error());
    task = *std::move(offered);
  }
  auto inputs = recorded_inputs(options.source, recording->head().header);
  inputs.push_back(options.recording);
  if (plan) inputs.push_back(options.plan);
  const auto claimed = claim_output(output, inputs);
  if (!claimed) return console.fail(claimed.error());
  const auto loaded =
      load_scene_of_recording(recording->head().header, options.source, progress, console.warn());
  if (!loaded) return console.fail(loaded.error());

  const auto model = report_model(loaded->model, progress);
  if (!model) return console.fail(model.error());
  std::optional<PlannedScene> scene;
  std::optional<PlanComparison> made;
  if (plan) {
    auto looked_up = scene_of_plan(*plan, *model, console);
    if (!looked_up) return console.fail(looked_up.error());
    scene = *std::move(looked_up);
    auto compared = compare_run(*scene, *recording, options.recording.string(),
                                static_cast<std::size_t>(options.device - 1), console);
    if (!compared) return console.fail(compared.error());
    made = *std::move(compared);
  }
  const auto named = [&](Error error) {
    if (error.where.empty()) error.where = options.recording.string();
    return error;
  };
  std::optional<TaskScore> score;
  if (task) {
    const auto in_scene = resolve_for_score(task->file, *model, progress);
    if (!in_scene) return console.fail(in_scene.error());
    auto made_score = score_recording(*in_scene, *recording, progress, options.ticks);
    if (!made_score) return console.fail(named(made_score.error()));
    score = *std::move(made_score);
  }
  std::optional<ScoredTask> scored;
  if (score) scored.emplace(ScoredTask{task->file, *score});
  std::optional<RehearsedPlan> rehearsed;
  if (made) rehearsed.emplace(RehearsedPlan{scene->plan, *made});
  const auto written =
      write_report(output, *recording, **model, progress,
                   {rehearsed ? &*rehearsed : nullptr, scored ? &*scored : nullptr, loaded->names_from});
  if (!written) return console.fail(named(written.error()));
  console.note("report: " + output.string());
  return kExitOk;
}

}  // namespace

void add_report(CLI::App& app, Run& run) {
  auto options = std::make_shared<ReportOptions>();
  CLI::App* verb = app.add_subcommand("report", "Turn a recording into one self-contained HTML page");
  verb->add_option("recording", options->recording, "Recording made by palpate simulate or explore")
      ->required();
  add_source_options(*verb, options->source, kMadeWithHelp);
  verb->add_option("-o,--output", options->output,
                   "Page to write (HTML); default: the name of the recording with .html");
  CLI::Option* plan = verb->add_option("-p,--plan", options->plan,
                                       "Plan file: the page compares the recording with it (palpate plan)");
  verb->add_option("--device", options->device,
                   "Number of the device whose tool is compared with the plan; default: 1")
      ->check(whole_between(1, kMaxDevices))
      ->needs(plan);
  verb->add_option("-t,--task", options->task,
                   "Task file, or the name of a task (palpate task list): the page shows its score; default: "
                   "the task named in the recording");
  add_tick_options(*verb, options->ticks);
  verb->footer(
      "Examples:\n"
      "  palpate report run.h5\n"
      "  palpate report run.h5 --task hold-steady\n"
      "  palpate report run.h5 --plan plan.toml\n"
      "  palpate report run.h5 scene.toml -o palpation.html\n\n"
      "The page is self-contained and loads nothing. A scene that has changed since the recording is "
      "refused.");
  verb->callback(
      [options, &run] { run = [options](Console& console) { return report_recording(*options, console); }; });
}

}  // namespace palpate::app
