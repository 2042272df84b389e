#include "palpate/stability/hold.h"
#include "palpate/json/json.h"

#include <cstdio>
#include <memory>
#include <optional>
#include <vector>

#include "input_files.h"
#include "palpate/base/output.h"
#include "palpate/loading/loading.h"
#include "palpate/stability/stability.h"
#include "scene_options.h"
#include "verb.h"

namespace palpate::app {
namespace {

struct HoldOptions {
  SceneSource source;
  std::string device = "premium-1.5", hand = "light-grip";
  std::optional<std::filesystem::path> output;
  std::vector<std::string> methods;
  std::vector<int> voxel;
  std::vector<double> at, from;
  double rate_hz = 1000, delay_ms = 1;
  std::optional<double> stiffness;
  std::optional<PreparationMethod> preparation;
  bool json = false;
};

// claims the picture file, if one is requested
Result<std::optional<OutputClaim>> check_hold(const HoldOptions& options) {
  using Claim = std::optional<OutputClaim>;
  if (options.at.empty() == options.voxel.empty())
    return Error{ErrorKind::kUsage, "no place is given to hold the tip at", "",
                 "give it with --at or --voxel"};
  if (!options.output) return Claim();
  if (const auto extension = options.output->extension(); !extension.empty() && extension != ".svg")
    return Error{ErrorKind::kUsage, "the output is an SVG picture", options.output->string(),
                 "give it a name that ends in .svg"};
  auto claimed = claim_output(*options.output, input_files(options.source));
  if (!claimed) return claimed.error();
  return Claim(*std::move(claimed));
}

Point<Patient> point_of(const std::vector<double>& at) {
  return {at[0], at[1], at[2]};
}

Result<Point<Patient>> position_of(const HoldOptions& options, const GridGeometry& grid) {
  if (!options.at.empty()) return point_of(options.at);
  const auto& v = options.voxel;
  if (!grid.contains(v[0], v[1], v[2]))
    return Error{ErrorKind::kBadInput,
                 "the volume has " + std::to_string(grid.dims[0]) + " x " + std::to_string(grid.dims[1]) +
                     " x " + std::to_string(grid.dims[2]) + " voxels",
                 "--voxel", "give indices from 0, along i, j and k"};
  return grid.X_PatientVoxel() * Point<Voxel>(v[0], v[1], v[2]);
}

std::vector<ForceMethod> methods_of(const HoldOptions& options, const LoadedScene& loaded) {
  std::vector<ForceMethod> methods;
  for (const std::string& name : options.methods) methods.push_back(*find_force_method(name));
  if (methods.empty()) methods.push_back(loaded.scene.force.method);
  return methods;
}

// Force gain at which the rendered stiffness of the stiffest tissue is the requested fraction of the
// recommended stiffness.
Result<double> force_gain(const HoldOptions& options, const Hold& hold, const Model& model,
                          const Progress& progress) {
  if (!options.stiffness) return 1.0;
  const auto recommended = recommended_stiffness_N_per_mm(hold.device, hold.rate_hz, hold.delay_s, progress);
  if (!recommended) return recommended;
  return *options.stiffness * *recommended / model.max_stiffness_N_per_mm();
}

std::string heading_of(const Hold& hold, const Model& model) {
  char text[200];
  std::snprintf(text, sizeof text, "at %.1f, %.1f, %.1f mm (LPS); %s, %s; %g Hz, %g ms of delay; %.3g N/mm",
                hold.at.x(), hold.at.y(), hold.at.z(), hold.device.name.c_str(), hold.hand.name.c_str(),
                hold.rate_hz, 1e3 * hold.delay_s, hold.force_gain * model.max_stiffness_N_per_mm());
  return text;
}

// state of the held tip, with the circumstance that may explain it
const char* state_of(const HoldResult& result) {
  if (result.inside) return "uncoupled: begun inside";
  if (result.wedged) return result.quiet() ? "quiet, wedged" : "not quiet, wedged";
  return result.quiet() ? "quiet" : "not quiet";
}

void print_table(const std::vector<HoldResult>& tips, const std::string& heading) {
  std::printf("%s\n%-16s %9s %9s %9s %8s %10s\n", heading.c_str(), "", "peak-peak", "20-500 Hz", "dominant",
              "force", "energy out");
  std::printf("%-16s %9s %9s %9s %8s %10s\n", "method", "um", "rms um", "Hz", "N", "mJ");
  for (const HoldResult& result : tips)
    std::printf("%-16s %9.1f %9.2f %9.0f %8.3f %10.4f  %s\n", std::string(name_of(result.method)).c_str(),
                result.buzz.peak_to_peak_um, result.buzz.rms_um, result.buzz.dominant_Hz, result.buzz.force_N,
                result.buzz.energy_mJ, state_of(result));
  std::printf("quiet: within two encoder steps, %g um\n", 2 * tips.front().encoder_step_um);
}

void print_json(const std::vector<HoldResult>& tips, const Hold& hold, const Model& model) {
  Json json{{"device", hold.device.name},
            {"hand", hold.hand.name},
            {"rate_Hz", hold.rate_hz},
            {"delay_ms", 1e3 * hold.delay_s},
            {"stiffness_N_per_mm", hold.force_gain * model.max_stiffness_N_per_mm()},
            {"from_mm", {hold.from.x(), hold.from.y(), hold.from.z()}},
            {"at_mm", {hold.at.x(), hold.at.y(), hold.at.z()}},
            {"quiet_within_um", 2 * tips.front().encoder_step_um}};
  for (const HoldResult& result : tips)
    json["methods"][std::string(name_of(result.method))] = {{"peak_to_peak_um", result.buzz.peak_to_peak_um},
                                                            {"rms_um", result.buzz.rms_um},
                                                            {"dominant_Hz", result.buzz.dominant_Hz},
                                                            {"force_N", result.buzz.force_N},
                                                            {"energy_out_mJ", result.buzz.energy_mJ},
                                                            {"quiet", result.quiet()},
                                                            {"inside", result.inside},
                                                            {"wedged", result.wedged}};
  std::printf("%s\n", json.dump(2).c_str());
}

int hold_target(const HoldOptions& options, Console& console) {
  const auto claimed = check_hold(options);
  if (!claimed) return console.fail(claimed.error());
  const Progress progress = console.progress();
  const auto loaded = load_touchable_target(options.source, console, options.preparation);
  if (!loaded) return console.fail(loaded.error());
  const auto methods = methods_of(options, *loaded);
  const auto model = prepared_with_cache(loaded->model, methods, progress);
  if (!model) return console.fail(model.error());

  Hold hold;
  hold.device = *find_plant_device(options.device);
  hold.hand = *find_plant_hand(options.hand);
  hold.rate_hz = options.rate_hz;
  hold.delay_s = 1e-3 * options.delay_ms;
  const auto point = position_of(options, (*model)->labels->geometry());
  if (!point) return console.fail(point.error());
  hold.at = *point;
  hold.from = options.from.empty() ? hold.at : point_of(options.from);
  const auto gain = force_gain(options, hold, **model, progress);
  if (!gain) return console.fail(gain.error());
  hold.force_gain = *gain;

  std::vector<HoldResult> tips;
  for (const ForceMethod method : methods) {
    hold.method = method;
    auto result = hold_tip(**model, hold, progress);
    if (!result) return console.fail(result.error());
    tips.push_back(*std::move(result));
  }
  const std::string heading = heading_of(hold, **model);
  if (options.json)
    print_json(tips, hold, **model);
  else
    print_table(tips, heading);
  if (!options.output) return kExitOk;
  if (const auto written = write_hold_picture(*options.output, tips, heading); !written)
    return console.fail(written.error());
  console.note("picture: " + options.output->string());
  return kExitOk;
}

template <class Named>
std::vector<std::string> names_of(const std::vector<Named>& all) {
  std::vector<std::string> names;
  for (const Named& one : all) names.push_back(one.name);
  return names;
}

CLI::Option* add_position_option(CLI::App& verb, const std::string& name, std::vector<double>& point_mm,
                                 const std::string& help) {
  return verb.add_option(name, point_mm, help)
      ->delimiter(',')
      ->expected(3)
      ->check(number_between(-1e6, 1e6))
      ->type_name("X,Y,Z");
}

void add_options(CLI::App& verb, HoldOptions& options) {
  add_source_options(verb, options.source)->required();
  add_position_option(verb, "--at", options.at, "Target of the hand: patient coordinates in mm, LPS");
  verb.add_option("--voxel", options.voxel, "Target of the hand as voxel indices, from 0")
      ->delimiter(',')
      ->expected(3)
      ->check(whole_between(0, 1000000))
      ->type_name("I,J,K");
  add_position_option(verb, "--from", options.from,
                      "Start of the hand, one second before it reaches the target; default: the target");
  std::vector<std::string> names;
  for (const ForceMethodInfo& info : kForceMethods) names.emplace_back(info.name);
  verb.add_option("--method", options.methods, "Force method; may be repeated; default: the scene's")
      ->check(CLI::IsMember(names));
  add_preparation_option(verb, options.preparation);
  verb.add_option("--device", options.device, "Simulated device")
      ->check(CLI::IsMember(names_of(known_plant_devices())))
      ->capture_default_str();
  verb.add_option("--hand", options.hand, "Simulated hand")
      ->check(CLI::IsMember(names_of(known_plant_hands())))
      ->capture_default_str();
  verb.add_option("--rate", options.rate_hz, "Servo rate in Hz")
      ->check(number_between(kLowestHold_hz, kHighestHold_hz))
      ->capture_default_str();
  verb.add_option("--delay", options.delay_ms, "Delay from a command to its force, in ms")
      ->check(number_between(0, 1e3 * SimulatedDevice::kMaxDelay_s))
      ->capture_default_str();
  verb.add_option("--stiffness", options.stiffness,
                  "Stiffness of the stiffest tissue as a fraction of the recommended one for this device, "
                  "rate and delay; default: the scene's stiffness")
      ->check(number_between(0.01, 10));
  verb.add_flag("-j,--json", options.json, "Print JSON instead of a table");
  verb.add_option("-o,--output", options.output, "Picture of the tip's motion to write (SVG)");
}

}  // namespace

void add_hold(CLI::App& app, Run& run) {
  auto options = std::make_shared<HoldOptions>();
  CLI::App* verb =
      app.add_subcommand("hold", "Measure the residual vibration of a tip that a simulated hand holds still");
  add_options(*verb, *options);
  verb->footer(
      "Examples:\n"
      "  palpate hold knee-phantom --at=20,-4,0.2 --preparation union-gaussian --method trilinear --method "
      "proxy \\\n      -o hold.svg\n"
      "  palpate hold scene.toml --voxel 238,272,43 --device touch --hand firm-grip --delay 3\n\n"
      "The hand moves to the target within one second and rests there for two; the figures are from the "
      "last\n"
      "second. Neither the scene's [workspace] nor the stiffness limit of a palpation is applied.\n"
      "docs/results/between-bones.md shows the gap between two bones.");
  verb->callback(
      [options, &run] { run = [options](Console& console) { return hold_target(*options, console); }; });
}

}  // namespace palpate::app
