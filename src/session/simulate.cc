#include <algorithm>
#include <chrono>
#include <cmath>
#include <ctime>

#include "palpate/preparation.h"
#include "palpate/session.h"
#include "palpate_version.h"
#include "session/script_text.h"
#include "session/scripted_hand.h"

namespace palpate {
namespace {

constexpr double kDefaultUserLimit_N = 3;
// a hold counts between these forces
constexpr double kHoldLow_N = 0.5, kHoldHigh_N = 2;
// a press with its hold, moves included, never takes this long; longer is a script that does not end
constexpr double kMostSeconds = 3600;

std::string utc_now() {
  const std::time_t now = std::chrono::system_clock::to_time_t(std::chrono::system_clock::now());
  std::tm utc;
  gmtime_r(&now, &utc);
  char text[32];
  std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &utc);
  return text;
}

RecordingHeader header_of(const LoadedScene& loaded, const Script& script) {
  const Model& model = *loaded.model;
  RecordingHeader header;
  header.palpate_version = PALPATE_VERSION;
  header.commit = PALPATE_COMMIT;
  header.build_type = PALPATE_BUILD_TYPE;
  header.compiler = PALPATE_COMPILER;
  const auto targets = simd_targets();
  header.simd_target = targets.empty() ? "" : targets.front();
  header.started_utc = utc_now();
  header.data_set = loaded.data_set;
  header.scene_title = model.title;
  header.model_hash = model.content_hash;
  header.model_version = model.version;
  header.rate_hz = script.rate_hz;
  header.seed = script.seed;
  header.device = script.device;
  header.hand = script.hand;
  header.script_text = script_text(script);
  for (const Segment& segment : model.segments)
    if (const Tissue* tissue = model.tissue_of(segment.id))
      header.structures.push_back({segment.id, segment.name, tissue->name, segment.colour});
  return header;
}

// longest unbroken hold, mean and peak of one structure, tick by tick
class HoldMeter {
 public:
  HoldMeter(const Model& model, LabelId label) {
    figure_.label = label;
    figure_.structure = model.name_of(label);
  }
  void see(const TickRecord& record) {
    const DeviceTick& device = record.device[0];
    const auto& f = device.force_N;
    const double force_N = std::sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]);
    const bool own = device.label == figure_.label;
    if (own) {
      sum_N_ += force_N;
      ++ticks_;
      figure_.peak_force_N = std::max(figure_.peak_force_N, force_N);
    }
    unbroken_s_ = own && force_N >= kHoldLow_N && force_N <= kHoldHigh_N ? unbroken_s_ + record.dt_s : 0;
    figure_.held_s = std::max(figure_.held_s, unbroken_s_);
  }
  HoldFigure figure() const {
    HoldFigure figure = figure_;
    figure.mean_force_N = ticks_ ? sum_N_ / static_cast<double>(ticks_) : 0;
    return figure;
  }

 private:
  HoldFigure figure_;
  double sum_N_ = 0, unbroken_s_ = 0;
  std::uint64_t ticks_ = 0;
};

void count_flags(RecordingSummary& summary, const TickRecord& record) {
  const std::uint32_t flags = record.device[0].flags;
  summary.ticks += 1;
  summary.run_hash = mix_run_hash(summary.run_hash, record.state_hash);
  summary.clamped += (flags & kFlagClamped) != 0;
  summary.not_finite += (flags & kFlagNotFinite) != 0;
  summary.outside += (flags & kFlagOutside) != 0;
  summary.paused += (flags & kFlagPaused) != 0;
}

Error at_line(Error error, const Script& script, int line) {
  error.where = line > 0 ? script.source + ":" + std::to_string(line) : script.source;
  return error;
}

// presses that the limit or the tissue cannot give, known before the first tick
std::vector<std::string> out_of_reach(const Script& script, const Model& model, double limit_N) {
  std::vector<std::string> trouble;
  for (std::size_t s = 0; s < script.steps.size(); ++s) {
    const auto* press = std::get_if<PressStep>(&script.steps[s]);
    if (!press || press->force_N <= std::min(limit_N, model.full_force_N)) continue;
    char text[120];
    std::snprintf(text, sizeof text,
                  "script line %d: asks for %.2f N, where at most %.2f N are allowed and %.2f N can be given",
                  script.lines[s], press->force_N, limit_N, model.full_force_N);
    trouble.push_back(text);
  }
  return trouble;
}

}  // namespace

Result<SimulationResult> simulate(const LoadedScene& loaded, const Script& script,
                                  const SimulationOptions& options, const std::filesystem::path& recording,
                                  const Progress& progress) {
  const Model& model = *loaded.model;
  const auto plant_device = find_plant_device(script.device);
  if (!plant_device) return at_line(plant_device.error(), script, script.device_line);
  const auto plant_hand = find_plant_hand(script.hand);
  if (!plant_hand) return at_line(plant_hand.error(), script, script.hand_line);
  Script run = script;
  if (options.seed) run.seed = *options.seed;
  if (options.rate_hz) run.rate_hz = *options.rate_hz;

  progress.report("finding surfaces", 0);
  auto hand = ScriptedHand::create(model, run);
  if (!hand) return hand.error();

  std::unique_ptr<RecordingWriter> writer;
  if (!recording.empty()) {
    auto created = RecordingWriter::create(recording, header_of(loaded, run));
    if (!created) return created.error();
    writer = std::move(*created);
  }

  // the least of device, user and scene limit
  SimulationResult result;
  const double device_N = plant_device->continuous_force_N;
  const double user_N = options.max_force_N ? std::min(*options.max_force_N, plant_device->peak_force_N)
                                            : std::min(device_N, kDefaultUserLimit_N);
  result.limit_N = std::min(user_N, model.scene_max_force_N);
  Parameters parameters;
  parameters.max_force_N = result.limit_N;

  result.trouble = out_of_reach(run, model, result.limit_N);

  SimulatedDevice device(*plant_device, *plant_hand);
  device.reset(hand->start());
  std::vector<HoldMeter> meters;
  for (const LabelId structure : hand->structures()) meters.emplace_back(model, structure);

  const double dt_s = 1 / run.rate_hz;
  const std::size_t block = static_cast<std::size_t>(run.rate_hz);  // one second
  std::vector<TickRecord> unwritten;
  unwritten.reserve(block);
  const auto write_block = [&]() -> Result<void> {
    if (!writer || unwritten.empty()) {
      unwritten.clear();
      return {};
    }
    auto written = writer->append(unwritten);
    unwritten.clear();
    return written;
  };

  SessionState state;
  Wrench wrench;
  bool stopped = false;
  while (true) {
    // sense, tick, feel, act
    const DeviceState sensed = device.read();
    TickRecord record;
    tick(model, parameters, {&sensed, 1}, dt_s, state, {&wrench, 1}, record);
    count_flags(result.summary, record);
    result.max_force_N = std::max(result.max_force_N, wrench.force_N.norm());
    for (HoldMeter& meter : meters) meter.see(record);
    unwritten.push_back(record);
    if (unwritten.size() == block) {
      if (auto written = write_block(); !written) return written.error();
      progress.report("palpating", hand->progress());
    }
    stopped = progress.stopped();
    if (stopped) break;

    const auto intention = hand->next(record, dt_s, parameters.rotation_target);
    if (!intention) break;
    if (state.time_s > kMostSeconds)
      return Error{ErrorKind::kBadInput, "the script has not ended after an hour of simulated time",
                   script.source, "look at its speeds, distances and seconds"};
    device.intend(*intention);
    device.advance(wrench, dt_s);
  }

  if (auto written = write_block(); !written) return written.error();
  // without its summary the recording counts as cut short, which it is
  if (stopped) return Progress::interrupted();
  result.trouble.insert(result.trouble.end(), hand->trouble().begin(), hand->trouble().end());
  result.summary.trouble = result.trouble;
  if (writer)
    if (auto finished = writer->finish(result.summary); !finished) return finished.error();
  progress.report("palpating", 1);
  for (const HoldMeter& meter : meters) result.holds.push_back(meter.figure());
  return result;
}

}  // namespace palpate
