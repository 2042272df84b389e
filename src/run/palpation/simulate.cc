#include <algorithm>
#include <cmath>

#include "palpate/loading/loading.h"
#include "palpate/model/changed_model.h"
#include "palpate/palpation/palpation.h"
#include "palpate/palpation/run_setup.h"
#include "palpate/palpation/virtual_run.h"
#include "palpate/recording/recorder.h"
#include "palpate/tissue/protected_distance.h"
#include "palpate/tissue/removed_volume.h"

namespace palpate {
namespace {

// bound on the duration of a press with its hold and motion; a longer script does not end
constexpr double kMaxSeconds = 3600;

}  // namespace

Result<SimulationResult> simulate(const LoadedScene& loaded, const std::optional<Script>& script,
                                  const SimulationOptions& options, const std::filesystem::path& recording,
                                  const Progress& progress) {
  if (auto touchable = require_touchable_tissue(loaded); !touchable) return touchable.error();
  auto setup = set_up_run(loaded, script, options, progress);
  if (!setup) return setup.error();
  const Model& model = *setup->model;  // model at the beginning of the run

  progress.report("finding surfaces", 0);
  auto hand = ScriptedHand::create(model, setup->script);
  if (!hand) return hand.error();

  std::unique_ptr<RecordingWriter> writer;
  if (!recording.empty()) {
    auto created = RecordingWriter::create(recording, header_of_run(loaded, *setup));
    if (!created) return created.error();
    writer = std::move(*created);
  }

  SimulationResult result;
  result.limit_N = setup->limit_N;
  result.problems = setup->problems;
  std::vector<HoldMeter> meters;
  for (const HoldRequest& hold : hand->requested()) meters.emplace_back(model, hold);

  VirtualRun run(setup->model, *setup, std::move(*hand), progress);
  const std::size_t block = static_cast<std::size_t>(setup->script.rate_hz);  // one second
  std::vector<TickRecord> unwritten;
  unwritten.reserve(block);
  RemovedVolume removed(model);
  ProtectedDistanceMeter nearest(model);
  const auto write_block = [&]() -> Result<void> {
    const auto reported = run.receive_events();
    for (const RecordingEvent& event : reported) {
      if (event.kind == RecordingEvent::Kind::kSweep) {
        const Cut cut = cut_of(event.sweep);
        removed.add({&cut, 1});
        if (cut.device != Cut::kBrokenOff) nearest.observe(cut.sweep);
      }
      if (event.kind == RecordingEvent::Kind::kModel) apply_stroke_change(event.change, removed);
    }
    auto written = writer && !unwritten.empty() ? writer->append(unwritten, reported) : Result<void>();
    unwritten.clear();
    return written;
  };

  bool stopped = false;
  do {
    const TickRecord& record = run.tick();
    result.summary.observe(record);
    if (options.on_tick) options.on_tick(record);
    nearest.observe(record);
    result.max_force_N = std::max(result.max_force_N, run.sent().force_N.norm());
    for (HoldMeter& meter : meters) meter.observe(record);
    unwritten.push_back(record);
    if (unwritten.size() == block) {
      if (auto written = write_block(); !written) return written.error();
      progress.report("palpating", run.hand().progress());
    }
    if (run.time_s() > kMaxSeconds)
      return Error{ErrorKind::kBadInput, "the script has not ended after an hour of simulated time",
                   setup->script.source, "check its speeds, distances and durations"};
    stopped = progress.stopped();
  } while (!stopped && run.act());

  if (auto written = write_block(); !written) return written.error();
  // an interrupted recording has no summary and counts as incomplete
  if (stopped) return Progress::interrupted();
  result.problems.insert(result.problems.end(), run.hand().problems().begin(), run.hand().problems().end());
  result.failed_steps = run.hand().problems().size();
  result.touches = run.hand().touches();
  result.summary.problems = result.problems;
  if (writer)
    if (auto finished = writer->finish(result.summary); !finished) return finished.error();
  progress.report("palpating", 1);
  for (const HoldMeter& meter : meters) result.holds.push_back(meter.figure());
  result.removed = removed_figures(model, removed);
  result.broken_off_mm3 = removed.broken_off_mm3();
  result.protected_structures = protected_figures(model, removed, nearest);
  return result;
}

}  // namespace palpate
