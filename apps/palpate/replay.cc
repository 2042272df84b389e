#include <chrono>
#include <cstdio>
#include <memory>
#include <thread>

#include "page_server.h"
#include "palpate/loading/loading.h"
#include "palpate/palpation/palpation.h"
#include "palpate/session/playback.h"
#include "scene_options.h"
#include "scoring.h"
#include "verb.h"

namespace palpate::app {
namespace {

struct ReplayOptions {
  std::filesystem::path recording;
  SceneSource source;
  bool view = false;
  std::optional<std::filesystem::path> plan;
  std::string task;
  TickRange ticks;
  ServingOptions serving;
};

// shows the recording in the page until it is interrupted
int show_recording(RecordingSource recording, const LoadedScene& loaded,
                   std::optional<PlayedTaskOptions> task, const ReplayOptions& options, Console& console) {
  const Progress progress = console.progress();
  std::shared_ptr<SharedPlan> plan;
  if (options.plan) {
    auto opened = SharedPlan::open(*options.plan, *loaded.model, false);
    if (!opened) return console.fail(opened.error());
    plan = *std::move(opened);
  }
  const auto playback = open_playback(std::move(recording), loaded.model, loaded.scene.modality, progress,
                                      std::move(task), std::move(plan));
  if (!playback) {
    Error error = playback.error();
    if (error.where.empty()) error.where = options.recording.string();
    return console.fail(error);
  }
  ViewerFaultQueue faults;
  const auto server = serve(**playback, options.serving, console, faults);
  if (!server) return console.fail(server.error());
  const auto published = publish(**playback, options.serving, console, faults);
  if (!published) return console.fail(published.error());
  console.note("to see it, open " + (*server)->url() + "; Ctrl-C ends it");
  while (!progress.stopped()) {
    faults.show_next(console);
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  return kExitOk;
}

int replay_recording(const ReplayOptions& options, Console& console) {
  if (options.view)
    if (const auto servable = ViewerServer::check(options.serving.viewers); !servable)
      return console.fail(servable.error());
  if (options.ticks.first > options.ticks.last) return console.fail(ticks_in_reverse());
  const Progress progress = console.progress();
  auto recording = RecordingSource::open(options.recording, progress);
  if (!recording) return console.fail(recording.error());
  std::optional<PlayedTaskOptions> task;
  const bool is_run = options.view && is_run_of_task(recording->head().header, options.task, options.ticks);
  if (is_run) {
    auto offered = task_of_recording(recording->head().header, options.task, options.recording, console);
    if (!offered) return console.fail(offered.error());
    task.emplace(PlayedTaskOptions{*std::move(offered), options.ticks});
  }
  const auto loaded =
      load_scene_of_recording(recording->head().header, options.source, progress, console.warn());
  if (!loaded) return console.fail(loaded.error());
  if (options.view) return show_recording(*std::move(recording), *loaded, std::move(task), options, console);

  const auto result = replay(*recording, loaded->model, progress);
  if (!result) {
    Error error = result.error();
    if (error.where.empty()) error.where = options.recording.string();
    return console.fail(error);
  }
  if (!result->identical) {
    std::printf("first difference at tick %llu: %s\n",
                static_cast<unsigned long long>(*result->first_difference), result->difference.c_str());
    return kExitLimit;
  }
  std::printf(
      "identical: %llu ticks, run hash %016llx%s\n", static_cast<unsigned long long>(result->ticks),
      static_cast<unsigned long long>(result->run_hash),
      recording->head().summary ? "" : " (the recording was cut short; its last second may be missing)");
  return kExitOk;
}

}  // namespace

void add_replay(CLI::App& app, Run& run) {
  auto options = std::make_shared<ReplayOptions>();
  CLI::App* verb = app.add_subcommand(
      "replay", "Replay the inputs of a recording and compare every tick, or show the recording");
  verb->add_option("recording", options->recording, "Recording made by palpate simulate or explore")
      ->required();
  add_source_options(*verb, options->source, kMadeWithHelp);
  CLI::Option* view = verb->add_flag(
      "--view", options->view,
      "Show the recording in the viewer's page, at any time and speed, until Ctrl-C; nothing is replayed");
  CLI::Option* task = verb->add_option("-t,--task", options->task,
                                       "Task file, or the name of a task (palpate task list): the page shows "
                                       "its progress and score; default: the task named in the recording");
  task->needs(view);
  add_tick_options(*verb, options->ticks);
  for (const char* each : {"--from-tick", "--to-tick"}) verb->get_option(each)->needs(view);
  const std::size_t others = verb->get_options().size();
  verb->add_option("--plan", options->plan, "Plan to show with the recording (palpate plan --help)");
  add_serving_options(*verb, options->serving);
  const auto all = verb->get_options();
  for (std::size_t i = others; i < all.size(); ++i) all[i]->needs(view);
  verb->footer(
      "Examples:\n"
      "  palpate replay run.h5\n"
      "  palpate replay run.h5 scene.toml\n"
      "  palpate replay run.h5 --view\n"
      "  palpate replay run.h5 --view --task hold-steady\n\n"
      "Exit code 0: every tick's state hash is the recorded one. 3: a tick differs; the first one is "
      "reported.\n"
      "docs/guide/viewer.md describes what the page shows of a recording.");
  verb->callback(
      [options, &run] { run = [options](Console& console) { return replay_recording(*options, console); }; });
}

}  // namespace palpate::app
