#include "palpate/report/report.h"

#include <memory>

#include "inputs.h"
#include "palpate/base/output.h"
#include "palpate/loading/loading.h"
#include "palpation.h"
#include "report_model.h"
#include "verb.h"

namespace palpate::app {
namespace {

struct ReportOptions {
  std::filesystem::path recording, output;
  std::string target;
  std::optional<int> volume;
};

int report_recording(const ReportOptions& options, Console& console) {
  std::filesystem::path output = options.output;
  if (output.empty()) output = std::filesystem::path(options.recording).replace_extension(".html");
  const Progress progress = console.progress();
  const auto recording = RecordingSource::open(options.recording, progress);
  if (!recording) return console.fail(recording.error());
  auto inputs = input_files(options.target.empty() ? recording->head().header.data_set : options.target);
  inputs.push_back(options.recording);
  const auto claimed = claim_output(output, inputs);
  if (!claimed) return console.fail(claimed.error());
  const auto loaded = load_scene_of_recording(recording->head().header, options.target, progress,
                                              console.warn(), options.volume);
  if (!loaded) return console.fail(loaded.error());

  const auto model = report_model(loaded->model, progress);
  if (!model) return console.fail(model.error());
  const auto written = write_report(output, *recording, **model, progress);
  if (!written) {
    Error error = written.error();
    if (error.where.empty()) error.where = options.recording.string();
    return console.fail(error);
  }
  console.note("report: " + output.string());
  return kExitOk;
}

}  // namespace

void add_report(CLI::App& app, Run& run) {
  auto options = std::make_shared<ReportOptions>();
  CLI::App* verb = app.add_subcommand("report", "Turn a recording into one self-contained HTML page");
  verb->add_option("recording", options->recording, "Recording made by palpate simulate or explore")
      ->required();
  verb->add_option("target", options->target,
                   "Scene file, volume or data set it was made with; not needed for data sets");
  add_volume_option(*verb, options->volume);
  verb->add_option("-o,--output", options->output, "Page to write; default: the recording's name with .html");
  verb->footer(
      "Examples:\n"
      "  palpate report run.h5\n"
      "  palpate report run.h5 scene.toml -o palpation.html\n\n"
      "The page loads nothing from anywhere. A scene that changed since the recording is refused.");
  verb->callback(
      [options, &run] { run = [options](Console& console) { return report_recording(*options, console); }; });
}

}  // namespace palpate::app
