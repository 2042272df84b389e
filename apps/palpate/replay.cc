#include <cstdio>
#include <memory>

#include "palpate/session.h"
#include "verb.h"

namespace palpate::app {
namespace {

struct ReplayOptions {
  std::filesystem::path recording;
  std::string target;
};

int replay_recording(const ReplayOptions& options, Console& console) {
  const Progress progress = console.progress();
  const auto recording = RecordingSource::open(options.recording, progress);
  if (!recording) return console.fail(recording.error());
  const auto loaded =
      load_scene_of_recording(recording->head().header, options.target, progress, console.warn());
  if (!loaded) return console.fail(loaded.error());

  const auto result = replay(*recording, loaded->model, progress);
  if (!result) {
    Error error = result.error();
    if (error.where.empty()) error.where = options.recording.string();
    return console.fail(error);
  }
  if (!result->identical) {
    std::printf("differs first at tick %llu: %s\n",
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
  CLI::App* verb = app.add_subcommand("replay", "Run a recording's inputs again and compare every tick");
  verb->add_option("recording", options->recording, "Recording made by palpate simulate or explore")
      ->required();
  verb->add_option("target", options->target,
                   "Scene file or volume it was made with; not needed for data sets");
  verb->footer(
      "Examples:\n"
      "  palpate replay run.h5\n"
      "  palpate replay run.h5 scene.toml\n\n"
      "Exit code 0: every tick's state hash is the recorded one. 3: the first tick that differs is named.");
  verb->callback(
      [options, &run] { run = [options](Console& console) { return replay_recording(*options, console); }; });
}

}  // namespace palpate::app
