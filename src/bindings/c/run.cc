#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "c/model.h"
#include "c/record.h"
#include "palpate/device/session_settings.h"
#include "palpate/palpation/palpation.h"
#include "palpate/servo/servo_loop.h"

struct plp_run {
  static constexpr palpate::c::Tag kTag = palpate::c::Tag::kRun;
  ~plp_run() { tag = palpate::c::Tag::kNone; }

  palpate::c::Tag tag = kTag;
  std::size_t devices = 1;
  std::vector<plp_record> records;  ///< The records of one tick are consecutive
  palpate::SimulationResult result;
};

namespace palpate::c {
namespace {

constexpr std::int64_t kMaxSeed = std::int64_t{1} << 53;

std::string range_text(double min, double max, const char* unit) {
  char text[80];
  std::snprintf(text, sizeof text, "give %g to %g %s", min, max, unit);
  return text;
}

Result<SimulationOptions> simulation_of(const plp_run_options& options) {
  SimulationOptions simulation;
  const auto method = method_of(options.method);
  if (!method) return method.error();
  simulation.method = *method;
  if (options.seed < -1 || options.seed > kMaxSeed)
    return Error{ErrorKind::kBadInput, "a seed of " + std::to_string(options.seed), "seed",
                 "give 0 to 2^53, or -1 for the script's"};
  if (options.seed >= 0) simulation.seed = static_cast<std::uint64_t>(options.seed);
  if (!std::isnan(options.max_force_N)) {
    if (!(options.max_force_N >= kMaxForceRange.min && options.max_force_N <= kMaxForceRange.max))
      return Error{ErrorKind::kBadInput, "a force limit of " + std::to_string(options.max_force_N) + " N",
                   "max_force_N", range_text(kMaxForceRange.min, kMaxForceRange.max, "N")};
    simulation.max_force_N = options.max_force_N;
  }
  if (!std::isnan(options.rate_hz)) {
    if (!(options.rate_hz >= kMinRate_hz && options.rate_hz <= kMaxRate_hz))
      return Error{ErrorKind::kBadInput, "a rate of " + std::to_string(options.rate_hz) + " ticks a second",
                   "rate_hz", range_text(kMinRate_hz, kMaxRate_hz, "Hz")};
    simulation.rate_hz = options.rate_hz;
  }
  return simulation;
}

Result<std::optional<Script>> script_of(const plp_run_options& options) {
  if (options.script_file != nullptr && options.script_text != nullptr)
    return Error{ErrorKind::kUsage, "both a script's file and its text are given", "script_text",
                 "give one of them"};
  if (options.script_file == nullptr && options.script_text == nullptr) return std::optional<Script>();
  auto script = options.script_file != nullptr ? load_script(options.script_file)
                                               : parse_script(options.script_text, "script");
  if (!script) return script.error();
  return std::optional(*std::move(script));
}

plp_run_info info_of(const plp_run& run) {
  plp_run_info info{};
  info.devices = static_cast<std::uint32_t>(run.devices);
  info.ticks = run.result.summary.ticks;
  info.run_hash = run.result.summary.run_hash;
  info.failed_steps = run.result.failed_steps;
  info.rate_hz = run.records.empty() ? 0 : 1 / run.records.front().dt_s;
  info.max_force_N = run.result.max_force_N;
  info.limit_N = run.result.limit_N;
  info.troubles = run.result.problems.size();
  return info;
}

}  // namespace
}  // namespace palpate::c

using palpate::c::fail;
using palpate::c::guarded;
using palpate::c::is_handle;

plp_status plp_simulate(const plp_model* model, const plp_run_options* options, plp_run** run) {
  return guarded([&] {
    if (run == nullptr) return fail(PLP_BAD_INPUT, "run: the place for the result is null");
    *run = nullptr;
    plp_run_options input;
    plp_run_options_init(&input, sizeof input);
    if (!is_handle(model) || (options != nullptr && !palpate::c::read(options, input))) return PLP_BAD_INPUT;
    auto simulation = palpate::c::simulation_of(input);
    if (!simulation) return fail(simulation.error());
    const auto script = palpate::c::script_of(input);
    if (!script) return fail(script.error());

    auto made = std::make_unique<plp_run>();
    simulation->on_tick = [&](const palpate::TickRecord& tick) {
      made->devices = static_cast<std::size_t>(tick.devices);
      for (std::size_t d = 0; d < made->devices; ++d) made->records.push_back(palpate::c::record_of(tick, d));
    };
    // the methods that a run uses by default; with_methods() stores them in the model for its next run
    const palpate::ForceMethod methods[] = {model->method, palpate::ForceMethod::kTrilinear};
    palpate::LoadedScene loaded = model->loaded;
    auto ready = palpate::c::with_methods(*model, methods);
    if (!ready) return fail(ready.error());
    loaded.model = *std::move(ready);
    auto result =
        palpate::simulate(loaded, *script, *simulation, input.recording == nullptr ? "" : input.recording,
                          palpate::c::cancellable());
    if (!result) return fail(result.error());
    made->result = *std::move(result);
    *run = made.release();
    return PLP_OK;
  });
}

plp_status plp_run_info_get(const plp_run* run, plp_run_info* info) {
  return guarded([&] {
    return is_handle(run) && palpate::c::write(palpate::c::info_of(*run), info) ? PLP_OK : PLP_BAD_INPUT;
  });
}

plp_status plp_run_records(const plp_run* run, size_t device, uint64_t first, size_t count,
                           plp_record* records) {
  return guarded([&] {
    const palpate::c::Elements<plp_record> out(records);
    if (!is_handle(run) || !out.ok()) return PLP_BAD_INPUT;
    const std::uint64_t ticks = run->records.size() / run->devices;
    if (device >= run->devices)
      return fail(PLP_BAD_INPUT, "device: there is no device " + std::to_string(device));
    if (first > ticks || count > ticks - first)
      return fail(PLP_BAD_INPUT, "count: the run has " + std::to_string(ticks) + " ticks");
    if (count > 0 && out.empty()) return fail(PLP_BAD_INPUT, "records: null");
    for (std::size_t n = 0; n < count; ++n) out.put(n, run->records[(first + n) * run->devices + device]);
    return PLP_OK;
  });
}

const char* plp_run_trouble(const plp_run* run, size_t index) {
  if (!is_handle(run) || index >= run->result.problems.size()) return nullptr;
  return run->result.problems[index].c_str();
}

void plp_run_destroy(plp_run* run) {
  if (run != nullptr && is_handle(run)) delete run;
}
