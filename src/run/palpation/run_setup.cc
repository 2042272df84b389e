#include <algorithm>
#include <cmath>

#include "palpate/base/utc.h"
#include "palpate/direct/force_field.h"
#include "palpate/palpation/plain_vectors.h"
#include "palpate/palpation/run_setup.h"
#include "palpate/servo/haptic_settings.h"
#include "palpate/stability/limited_stiffness.h"
#include "palpate/volume/simd_targets.h"
#include "palpate_version.h"
#include "palpation/default_script.h"
#include "palpation/script_text.h"

namespace palpate {
namespace {

constexpr double kDefaultUserLimit_N = 3;

Error at_line(Error error, const Script& script, int line) {
  error.where = line > 0 ? script.source + ":" + std::to_string(line) : script.source;
  return error;
}

// the initial method and those that the script selects
std::vector<ForceMethod> methods_of(const RunSetup& setup) {
  std::vector<ForceMethod> methods{setup.parameters.method};
  for (const ScriptStep& step : setup.script.steps)
    if (const auto* change = std::get_if<MethodStep>(&step)) methods.push_back(change->method);
  return methods;
}

/// Press steps that the limit or the tissue does not permit.
/// @param stiffness_ratio  rendered by nominal stiffness of the stiffest tissue
std::vector<std::string> out_of_reach(const RunSetup& setup, double stiffness_ratio) {
  std::vector<std::string> problems;
  ForceMethod method = setup.parameters.method;
  for (std::size_t s = 0; s < setup.script.steps.size(); ++s) {
    if (const auto* change = std::get_if<MethodStep>(&setup.script.steps[s])) method = change->method;
    const auto* press = std::get_if<PressStep>(&setup.script.steps[s]);
    // the proxy's force grows with depth without bound
    const double max_N = method == ForceMethod::kProxy ? setup.limit_N
                                                       : setup.model->force_field(method).full_force_N() *
                                                             setup.workspace.force_gain * stiffness_ratio;
    if (!press || press->force_N <= std::min(setup.limit_N, max_N)) continue;
    char text[120];
    std::snprintf(text, sizeof text,
                  "script line %d: asks for %.2f N, but at most %.2f N are allowed and %.2f N are possible",
                  setup.script.lines[s], press->force_N, setup.limit_N, max_N);
    problems.push_back(text);
  }
  return problems;
}

// fields of direct methods are not updated when material is removed
Result<void> check_burr(const Model& model, const RunSetup& setup) {
  if (!model.has_burr()) return {};
  for (const ForceMethod method : methods_of(setup))
    if (method != ForceMethod::kProxy)
      return Error{ErrorKind::kUsage,
                   "a tool of the scene is a " + cutter_name(model) + ", and " +
                       std::string(name_of(method)) + " cannot cut",
                   "", "use the proxy: leave out --method and the method steps of the script"};
  return {};
}

}  // namespace

Result<RunSetup> set_up_run(const LoadedScene& loaded, const std::optional<Script>& supplied,
                            const SimulationOptions& options, const Progress& progress) {
  const auto for_knee = supplied ? std::nullopt : knee_script(*loaded.model);
  const Script script = supplied ? *supplied : for_knee.value_or(Script{});
  const auto device = find_plant_device(script.device);
  if (!device) return at_line(device.error(), script, script.device_line);
  const auto hand = find_plant_hand(script.hand);
  if (!hand) return at_line(hand.error(), script, script.hand_line);

  RunSetup setup{nullptr, script, *device, *hand, loaded.scene.workspace, {}, 0, {}, options.task};
  if (options.seed) setup.script.seed = *options.seed;
  if (options.rate_hz) setup.script.rate_hz = *options.rate_hz;

  // minimum of device, user and scene limit
  const double user_N = options.max_force_N ? std::min(*options.max_force_N, device->peak_force_N)
                                            : std::min(device->continuous_force_N, kDefaultUserLimit_N);
  setup.limit_N = std::min(user_N, loaded.model->scene_max_force_N);
  setup.parameters.max_force_N = user_N;
  setup.parameters.method = options.method.value_or(loaded.scene.force.method);
  if (auto fine = check_burr(*loaded.model, setup); !fine) return fine.error();
  // a simulated hand plans its places in the field of the direct methods
  std::vector<ForceMethod> methods = methods_of(setup);
  methods.push_back(ForceMethod::kTrilinear);
  auto model = prepared_with_cache(loaded.model, methods, progress);
  if (!model) return model.error();
  setup.model = *std::move(model);
  setup.parameters.device[0] = device_parameters(SimulatedDevice(*device, *hand).info(), setup.workspace);
  const auto limited = limited_stiffness(*setup.model, setup.workspace, setup.parameters.method, *device,
                                         setup.script.rate_hz, setup.script.delay_s, progress);
  if (!limited) return limited.error();
  setup.parameters.device[0].max_stiffness_N_per_mm = limited->max_N_per_mm;
  const LimitedDamping damping =
      limited_damping(*setup.model, setup.workspace, *device, setup.script.rate_hz, setup.script.delay_s);
  setup.parameters.device[0].max_damping_N_s_per_mm = damping.max_N_s_per_mm;
  setup.parameters.device[0].delay_s = setup.script.delay_s;
  if (!supplied && !for_knee) {
    progress.report("planning the default script", 0);
    if (auto planned = plan_default_script(*setup.model, setup.parameters, setup.script); !planned)
      return planned.error();
  }
  setup.problems = out_of_reach(
      setup, limited->max_N_per_mm / std::max(limited->requested_N_per_mm, limited->max_N_per_mm));
  setup.problems.insert(setup.problems.end(), setup.script.limitations.begin(),
                        setup.script.limitations.end());
  if (!damping.clamped.empty()) setup.problems.insert(setup.problems.begin(), damping.clamped);
  if (!limited->clamped.empty()) setup.problems.insert(setup.problems.begin(), limited->clamped);
  return setup;
}

Result<RunSetup> set_up_guided_run(const LoadedScene& loaded, const SimulationOptions& options,
                                   const Progress& progress) {
  RunSetup setup{nullptr, {}, {}, {}, loaded.scene.workspace, {}, 0, {}, options.task};
  setup.script.device.clear();
  setup.script.hand.clear();
  if (options.rate_hz) setup.script.rate_hz = *options.rate_hz;
  setup.parameters.max_force_N = options.max_force_N.value_or(kDefaultUserLimit_N);
  setup.limit_N = std::min(setup.parameters.max_force_N, loaded.model->scene_max_force_N);
  setup.parameters.method = options.method.value_or(loaded.scene.force.method);
  if (auto fine = check_burr(*loaded.model, setup); !fine) return fine.error();
  auto model = prepared_with_cache(loaded.model, methods_of(setup), progress);
  if (!model) return model.error();
  setup.model = *std::move(model);
  return setup;
}

RecordingHeader header_of_run(const LoadedScene& loaded, const RunSetup& setup) {
  const Model& model = *loaded.model;
  RecordingHeader header;
  header.palpate_version = PALPATE_VERSION;
  header.commit = PALPATE_COMMIT;
  header.build_type = PALPATE_BUILD_TYPE;
  header.compiler = PALPATE_COMPILER;
  const auto targets = simd_targets();
  header.simd_target = targets.empty() ? "" : targets.front();
  header.haptic_settings = haptic_settings_text();
  header.tissue_cell_factor = setup.model->tissue_cell_factor;
  header.started_utc = utc_now();
  header.data_set = loaded.data_set;
  header.task = setup.task;
  header.scene_title = model.title;
  header.model_hash = model.content_hash;
  header.model_version = model.version;
  header.rate_hz = setup.script.rate_hz;
  header.seed = setup.script.seed;
  header.device = setup.script.device;
  header.hand = setup.script.hand;
  // without a script a person leads the tip
  header.simulated = !setup.script.steps.empty();
  if (header.simulated) header.script_text = script_text(setup.script);
  if (has_scope(setup.script)) header.devices = 2;
  for (const Segment& segment : model.segments)
    if (const Tissue* tissue = model.tissue_of(segment.id))
      header.structures.push_back({segment.id, segment.name, tissue->name, segment.colour});
  return header;
}

}  // namespace palpate
