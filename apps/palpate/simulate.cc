#include <array>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <system_error>

#include "input_files.h"
#include "palpate/base/output.h"
#include "palpate/device/session_settings.h"
#include "palpate/palpation/palpation.h"
#include "palpate/report/report.h"
#include "report_model.h"
#include "scene_options.h"
#include "scoring.h"
#include "verb.h"

namespace palpate::app {
namespace {

struct SimulateOptions {
  SceneSource source;
  std::optional<std::filesystem::path> script, recording, report;
  std::optional<double> max_force_N, rate_hz;
  std::optional<std::uint64_t> seed;
  std::optional<ForceMethod> method;
  std::string task;
};

// output files of a run; empty: not written
struct Outputs {
  std::filesystem::path recording, report;
  std::vector<OutputClaim> claims;
};

// Determines and claims the outputs before any work. A report is made from a recording: if no recording is
// named, it is written next to the report, and then replaces no existing file.
Result<Outputs> outputs_of(const SimulateOptions& options) {
  Outputs outputs{options.recording.value_or(""), options.report.value_or(""), {}};
  const bool derived = !outputs.report.empty() && outputs.recording.empty();
  if (derived) outputs.recording = std::filesystem::path(outputs.report).replace_extension(".h5");
  if (same_file(outputs.recording, outputs.report))
    return Error{ErrorKind::kUsage, "the recording and the report would be the same file",
                 outputs.report.string(), "name the recording with -o"};
  std::error_code ignored;
  if (derived && std::filesystem::exists(outputs.recording, ignored))
    return Error{ErrorKind::kUsage, "the recording would replace this file next to the report",
                 outputs.recording.string(), "name the recording with -o"};

  auto inputs = input_files(options.source);
  if (options.script) inputs.push_back(*options.script);
  for (const auto& output : {outputs.recording, outputs.report}) {
    if (output.empty()) continue;
    auto claimed = claim_output(output, inputs);
    if (!claimed) return claimed.error();
    outputs.claims.push_back(*std::move(claimed));
  }
  return outputs;
}

void print(const SimulationResult& result, const Model& model) {
  print_touches(result.touches);
  print_holds(result.holds);
  print_removed(result.removed);
  if (result.broken_off_mm3 > 0) std::printf("%.1f mm3 of it were cut loose\n", result.broken_off_mm3);
  print_protected(result.protected_structures, cutter_name(model));
  std::printf("largest force %.3f N of %.3f N allowed; %llu ticks, %llu clamped, %llu not finite\n",
              result.max_force_N, result.limit_N, static_cast<unsigned long long>(result.summary.ticks),
              static_cast<unsigned long long>(result.summary.clamped),
              static_cast<unsigned long long>(result.summary.not_finite));
  std::printf("run hash %016llx\n", static_cast<unsigned long long>(result.summary.run_hash));
}

int simulate_target(const SimulateOptions& options, Console& console) {
  const auto outputs = outputs_of(options);
  if (!outputs) return console.fail(outputs.error());
  std::optional<OfferedTask> task;
  if (!options.task.empty()) {
    auto offered = offered_task(options.task);
    if (!offered) return console.fail(offered.error());
    task = *std::move(offered);
  }
  const Progress progress = console.progress();
  const auto loaded = load_touchable_target(options.source, console);
  if (!loaded) return console.fail(loaded.error());
  const auto script = script_of(options.script);
  if (!script) return console.fail(script.error());

  SimulationOptions simulation;
  simulation.max_force_N = options.max_force_N;
  simulation.seed = options.seed;
  simulation.rate_hz = options.rate_hz;
  simulation.method = options.method;
  if (task) simulation.task = recorded_task(*task, loaded->data_set);
  // a run that is interrupted after planning leaves a recording
  const auto written = [&] {
    std::error_code none;
    return std::filesystem::last_write_time(outputs->recording, none);
  };
  const auto before = written();
  const auto result = simulate(*loaded, *script, simulation, outputs->recording, progress);
  if (!result) {
    if (result.error().kind == ErrorKind::kInterrupted && written() != before)
      console.note("the incomplete recording is kept: " + outputs->recording.string());
    return console.fail(result.error());
  }
  for (const std::string& problems : result->problems) console.warn()(problems);
  print(*result, *loaded->model);
  if (!outputs->recording.empty()) console.note("recording: " + outputs->recording.string());

  if (!outputs->report.empty()) {
    const auto recorded = RecordingSource::open(outputs->recording, progress);
    if (!recorded) return console.fail(recorded.error());
    const auto model = report_model(loaded->model, progress);
    if (!model) return console.fail(model.error());
    if (const auto reported =
            write_report(outputs->report, *recorded, **model, progress, {.names_from = loaded->names_from});
        !reported)
      return console.fail(reported.error());
    console.note("report: " + outputs->report.string());
  }
  return result->failed_steps == 0 ? kExitOk : kExitLimit;
}

}  // namespace

void add_simulate(CLI::App& app, Run& run) {
  auto options = std::make_shared<SimulateOptions>();
  CLI::App* verb = app.add_subcommand("simulate", "Palpate a scene with a simulated hand and record the run");
  add_source_options(*verb, options->source)->required();
  verb->add_option("-s,--script", options->script,
                   "Palpation script (TOML); default: one planned for the scene");
  verb->add_option("-o,--output", options->recording, "Recording to write (HDF5)");
  verb->add_option("--report", options->report,
                   "Report page to write (HTML); the recording is written next to it unless -o is given");
  verb->add_option("-t,--task", options->task,
                   "Task file, or the name of a task (palpate task list), to name in the recording");
  verb->add_option("--max-force", options->max_force_N,
                   "Force limit in N; default: the lesser of the device's continuous rating and 3 N")
      ->check(number_between(kMaxForceRange.min, kMaxForceRange.max));
  verb->add_option("--rate", options->rate_hz, "Servo rate in Hz; default: the script's")
      ->check(number_between(250, 10000));
  verb->add_option("--seed", options->seed, "Seed of the hand's tremor; default: the script's")
      ->check(whole_between(0, 9007199254740991));
  add_method_option(*verb, "Initial force method; default: the scene's", kForceMethods, options->method);
  verb->footer(
      "Examples:\n"
      "  palpate simulate knee-phantom --report run.html\n"
      "  palpate simulate knee-atlas -o atlas.h5 --max-force 3\n"
      "  palpate simulate scene.toml --script press.toml -o run.h5\n"
      "  palpate simulate labels.nii.gz --report run.html     with a proposed scene\n"
      "  palpate simulate STUDY seg.dcm --report run.html     a folder of DICOM and its segmentation\n"
      "  palpate simulate knee-phantom --method smooth-sphere -o smooth.h5\n\n"
      "The simulated hand and device run on a virtual clock: the same scene, script and seed give the same "
      "run\n"
      "bit for bit. docs/guide/script.md documents scripts, docs/reference/recording.md recordings.\n"
      "\n" +
      hold_definition() + " The exit code is then 3.");
  verb->callback(
      [options, &run] { run = [options](Console& console) { return simulate_target(*options, console); }; });
}

}  // namespace palpate::app
