#include <cstdio>
#include <memory>

#include "inputs.h"
#include "palpate/base/output.h"
#include "palpate/loading/loading.h"
#include "palpate/palpation/palpation.h"
#include "palpate/volume_io/volume_io.h"
#include "palpation.h"
#include "verb.h"

namespace palpate::app {
namespace {

struct ExportOptions {
  std::filesystem::path recording;
  std::string target;
  std::optional<int> volume;
  std::filesystem::path output;
};

int export_labels(const ExportOptions& options, Console& console) {
  const Progress progress = console.progress();
  const auto recording = RecordingSource::open(options.recording, progress);
  if (!recording) return console.fail(recording.error());
  auto inputs = input_files(options.target.empty() ? recording->head().header.data_set : options.target);
  inputs.push_back(options.recording);
  const auto claimed = claim_output(options.output, inputs);
  if (!claimed) return console.fail(claimed.error());
  const auto loaded = load_scene_of_recording(recording->head().header, options.target, progress,
                                              console.warn(), options.volume);
  if (!loaded) return console.fail(loaded.error());
  const auto left = labels_left(*recording, *loaded->model, progress);
  if (!left) {
    Error error = left.error();
    if (error.where.empty()) error.where = options.recording.string();
    return console.fail(error);
  }
  if (auto written = write_labels(options.output, left->labels); !written)
    return console.fail(written.error());
  print_removed(left->removed);
  if (left->removed.empty()) console.note("nothing was taken away in this recording");
  console.note("labels: " + options.output.string());
  return kExitOk;
}

}  // namespace

void add_export(CLI::App& app, Run& run) {
  auto options = std::make_shared<ExportOptions>();
  CLI::App* verb = app.add_subcommand("export", "Write the labels that a recorded burr has left");
  verb->add_option("recording", options->recording, "Recording made by palpate simulate or explore")
      ->required();
  verb->add_option("target", options->target,
                   "Scene file or volume it was made with; not needed for data sets");
  add_volume_option(*verb, options->volume);
  verb->add_option("-o,--output", options->output, "Label map to write: .seg.nrrd, .nrrd, .nii or .nii.gz")
      ->required();
  verb->footer(
      "Examples:\n"
      "  palpate export run.h5 scene.toml -o left.seg.nrrd\n\n"
      "A voxel of a felt structure is gone where its centre was swept. Prints how much of each structure "
      "that\n"
      "is, to 1/64 of a voxel. docs/burr.md says what a burr does.");
  verb->callback(
      [options, &run] { run = [options](Console& console) { return export_labels(*options, console); }; });
}

}  // namespace palpate::app
