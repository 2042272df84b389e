#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>

#include "apps/command/text.h"
#include "input_files.h"
#include "palpate/base/file.h"
#include "palpate/base/output.h"
#include "palpate/base/printable.h"
#include "palpate/json/json.h"
#include "palpate/rehearsal/plan_from_markups.h"
#include "plan_comparison.h"
#include "scene_options.h"
#include "verb.h"

/// Rehearsal: plans, and their comparison with recordings.
namespace palpate::app {
namespace {

constexpr std::size_t kMaxMarkups_bytes = std::size_t{1} << 24;

struct PlanOptions {
  std::filesystem::path markups, plan, recording, output, json;
  SceneSource source;
  std::string title;
  int device = 1;
};

std::string planned_name(const std::string& name) {
  return pad_or_truncate(printable_name(name), 24) + " ";
}

// ---- from-markups

int from_markups(const PlanOptions& options, Console& console) {
  const auto claimed = claim_output(options.output, std::array{options.markups});
  if (!claimed) return console.fail(claimed.error());
  const auto text = read_file(options.markups, kMaxMarkups_bytes);
  if (!text) return console.fail(text.error());
  const auto made = plan_from_markups(*text, options.title, options.markups.string());
  if (!made) return console.fail(made.error());
  for (const std::string& name : made->left_out)
    console.warn()(printable_name(name) + " does not define a trajectory: left out");
  // a plan that cannot be parsed again, e.g. with a title without a letter, is not written
  const std::string plan = plan_text(made->plan);
  if (const auto again = parse_plan(plan, options.output.string()); !again)
    return console.fail(again.error());
  if (const auto written = write_file(options.output, plan); !written) return console.fail(written.error());
  console.note("plan: " + options.output.string());
  return kExitOk;
}

// ---- show

std::string allowed_text(const std::optional<double>& allowed, const char* unit) {
  if (!allowed) return "no limit";
  char text[64];
  std::snprintf(text, sizeof text, "at most %g %s", *allowed, unit);
  return text;
}

void print_trajectory(const PlanTrajectory& trajectory) {
  std::printf("trajectory %s\n", printable_name(trajectory.name).c_str());
  std::printf("  entry           %.2f, %.2f, %.2f mm\n", trajectory.entry.x(), trajectory.entry.y(),
              trajectory.entry.z());
  std::printf("  target          %.2f, %.2f, %.2f mm\n", trajectory.target.x(), trajectory.target.y(),
              trajectory.target.z());
  std::printf("  depth           %.2f mm\n", trajectory.length_mm());
  std::printf("  allowed errors  entry %s, target %s, angle %s, depth %s\n",
              allowed_text(trajectory.entry_within_mm, "mm").c_str(),
              allowed_text(trajectory.target_within_mm, "mm").c_str(),
              allowed_text(trajectory.angle_within_deg, "degrees").c_str(),
              allowed_text(trajectory.depth_within_mm, "mm").c_str());
}

// prints the structures along the planned path, in order, with the length within each
void print_structures_on_path(const PlannedScene& scene, std::size_t n) {
  constexpr double kStep_mm = 0.1;
  const PlanTrajectory& trajectory = scene.plan.file.trajectories[n];
  const Bricks<LabelId>& labels = *scene.model->labels;
  const auto X_VoxelPatient = labels.geometry().X_PatientVoxel().inverse();
  const int steps = static_cast<int>(std::ceil(trajectory.length_mm() / kStep_mm));
  std::vector<std::pair<LabelId, double>> through;
  for (int step = 0; step < steps; ++step) {
    const Point<Patient> at =
        trajectory.entry + trajectory.axis() * (trajectory.length_mm() * (step + 0.5) / steps);
    const Eigen::Array3d voxel = (X_VoxelPatient * at).eigen().array().round().max(-1e9).min(1e9);
    const LabelId label =
        labels.anywhere(static_cast<int>(voxel[0]), static_cast<int>(voxel[1]), static_cast<int>(voxel[2]));
    if (through.empty() || through.back().first != label) through.emplace_back(label, 0);
    through.back().second += trajectory.length_mm() / steps;
  }
  std::string text;
  for (const auto& [label, mm] : through) {
    char length[32];
    std::snprintf(length, sizeof length, " %.1f mm", mm);
    text += (text.empty() ? "" : ", ") +
            (label == 0 ? std::string("nothing") : printable_name(scene.model->name_of(label))) + length;
  }
  std::printf("  passes through  %s\n", text.c_str());
}

void print_distances_along_path(const PlannedScene& scene, std::size_t n) {
  constexpr double kStep_mm = 0.1;
  const PlanTrajectory& trajectory = scene.plan.file.trajectories[n];
  const std::vector<bool>& enters = scene.plan.enters[n];
  double entry_mm = std::numeric_limits<double>::infinity();
  const int steps = static_cast<int>(std::ceil(trajectory.length_mm() / kStep_mm));
  for (const StructureDistance& distance : scene.distances) {
    if (distance.label() < enters.size() && enters[distance.label()])
      entry_mm = std::min(entry_mm, distance.distance_mm(trajectory.entry));
    const auto requested = scene.plan.distances_mm.find(distance.label());
    if (requested == scene.plan.distances_mm.end()) continue;
    double min_mm = std::numeric_limits<double>::infinity();
    for (int step = 0; step <= steps; ++step)
      min_mm =
          std::min(min_mm, distance.distance_mm(trajectory.entry + (trajectory.target - trajectory.entry) *
                                                                       (static_cast<double>(step) / steps)));
    std::printf("  distance to %s %.2f mm at least; %g mm required for the outside of the tool\n",
                planned_name(scene.model->name_of(distance.label())).c_str(), min_mm, requested->second);
  }
  if (std::isfinite(entry_mm))
    std::printf("  entry           %.2f mm %s the surface that it enters\n", std::abs(entry_mm),
                entry_mm > 0 ? "outside" : "below");
}

double all_mm3(const VolumesByLabel& volumes) {
  double sum_mm3 = 0;
  for (const auto& [label, mm3] : volumes) sum_mm3 += mm3;
  return sum_mm3;
}

int show_plan(const PlanOptions& options, Console& console) {
  const auto plan = load_plan(options.plan);
  if (!plan) return console.fail(plan.error());
  std::optional<PlannedScene> scene;
  std::optional<PlannedVolumes> volumes;
  if (!options.source.target.empty()) {
    const auto loaded = load_target(options.source, console);
    if (!loaded) return console.fail(loaded.error());
    auto looked_up = scene_of_plan(*plan, loaded->model, console);
    if (!looked_up) return console.fail(looked_up.error());
    scene = *std::move(looked_up);
    auto counted = planned_volumes(scene->plan, *scene->model, console.progress());
    if (!counted) return console.fail(counted.error());
    volumes = *std::move(counted);
  }
  std::printf("%s\n", printable_name(plan->title).c_str());
  for (std::size_t n = 0; n < plan->trajectories.size(); ++n) {
    print_trajectory(plan->trajectories[n]);
    if (!scene) continue;
    print_structures_on_path(*scene, n);
    print_distances_along_path(*scene, n);
  }
  for (std::size_t n = 0; n < plan->regions.size(); ++n) {
    const PlanRegion& region = plan->regions[n];
    std::printf("remove          %s", printable_name(region.name).c_str());
    if (volumes) std::printf("  %.1f mm3", all_mm3(volumes->of_regions[n]));
    std::printf("\n");
  }
  for (const PlanDistance& distance : plan->distances) {
    std::string names;
    for (const LabelReference& structure : distance.structures) {
      const auto* number = std::get_if<int>(&structure);
      names += (names.empty() ? "" : ", ") + (number ? "label " + std::to_string(*number)
                                                     : printable_name(std::get<std::string>(structure)));
    }
    std::printf("keep away       %g mm from %s\n", distance.distance_mm, names.c_str());
  }
  return kExitOk;
}

// ---- compare

std::string verdict(const ToleratedValue& figure) {
  return !figure.allowed ? "" : figure.is_within_limit() ? "kept" : "NOT KEPT";
}

void print_figure(const char* name, const ToleratedValue& figure, const char* unit, const std::string& more) {
  char value[48];
  if (std::isnan(figure.value))
    std::snprintf(value, sizeof value, "none");
  else
    std::snprintf(value, sizeof value, "%.2f %s", figure.value, unit);
  std::printf("  %s%s%s%s%s\n", pad_or_truncate(name, 16).c_str(), pad_or_truncate(value, 16).c_str(),
              pad_or_truncate(figure.allowed ? allowed_text(figure.allowed, unit) : "", 20).c_str(),
              pad_or_truncate(verdict(figure), 10).c_str(), more.c_str());
}

std::string at_tick(const RunPoint& point) {
  char text[64];
  std::snprintf(text, sizeof text, "at %.3f s, tick %llu", point.time_s,
                static_cast<unsigned long long>(point.tick));
  return text;
}

void print_made(const PlanTrajectory& planned, const TrajectoryResult& done) {
  std::printf("trajectory %s\n", printable_name(planned.name).c_str());
  const bool is_entered = done.entry_kind != EntryKind::kNone;
  print_figure("entry error", done.entry_error_mm, "mm",
               is_entered ? std::string(word_of(done.entry_kind)) + " " + at_tick(done.entry)
                          : "the structures were not reached");
  char parts[96];
  std::snprintf(parts, sizeof parts, "%.2f mm across, %.2f mm %s, ", done.lateral_mm, std::abs(done.along_mm),
                done.along_mm > 0 ? "beyond" : "before");
  print_figure("target error", done.target_error_mm, "mm",
               std::isnan(done.target_error_mm.value) ? "" : parts + at_tick(done.nearest));
  char line[64] = "";
  if (!std::isnan(done.line_rms_mm))
    std::snprintf(line, sizeof line, "%.2f mm off its own line", done.line_rms_mm);
  print_figure("angle", done.angle_deg, "degrees", line);
  char depth[64] = "";
  if (!std::isnan(done.depth_mm))
    std::snprintf(depth, sizeof depth, "%.2f of %.2f mm", done.depth_mm, planned.length_mm());
  print_figure("depth error", done.depth_error_mm, "mm", depth);
  if (!std::isnan(done.shaft_deg)) std::printf("  shaft           %.2f degrees\n", done.shaft_deg);
}

void print_comparison(const PlannedScene& scene, const PlanComparison& made) {
  const PlanFile& plan = scene.plan.file;
  std::printf("%s: %llu ticks, %.3f s\n", printable_name(plan.title).c_str(),
              static_cast<unsigned long long>(made.ticks), made.time_s);
  for (std::size_t n = 0; n < made.trajectories.size(); ++n)
    print_made(plan.trajectories[n], made.trajectories[n]);
  if (!made.regions.empty()) {
    std::printf("%s%s%s%s\n", pad_or_truncate("removed, mm3", 27).c_str(),
                pad_or_truncate("planned", 12).c_str(), pad_or_truncate("taken", 12).c_str(), "left");
    for (std::size_t n = 0; n < made.regions.size(); ++n)
      std::printf("  %s%-12.1f%-12.1f%.1f\n", planned_name(plan.regions[n].name).c_str(),
                  made.regions[n].planned_mm3, made.regions[n].removed_mm3, made.regions[n].remaining_mm3());
  }
  if (!made.volumes.empty()) {
    std::printf("%s%s%s%s%s\n", pad_or_truncate("by structure, mm3", 27).c_str(),
                pad_or_truncate("planned", 12).c_str(), pad_or_truncate("taken", 12).c_str(),
                pad_or_truncate("left", 12).c_str(), "outside the plan");
    for (const StructureVolume& volume : made.volumes)
      std::printf("  %s%-12.1f%-12.1f%-12.1f%.1f\n", planned_name(scene.model->name_of(volume.label)).c_str(),
                  volume.in_plan.planned_mm3, volume.in_plan.removed_mm3, volume.in_plan.remaining_mm3(),
                  volume.outside_mm3);
  }
  std::printf("%s%s%s\n", pad_or_truncate("nearest to", 27).c_str(), pad_or_truncate("mm", 12).c_str(),
              "asked");
  for (const StructureClearance& approach : made.approaches) {
    char requested[32] = "";
    if (approach.requested_mm) std::snprintf(requested, sizeof requested, "%g", *approach.requested_mm);
    std::printf("  %s%-12.2f%s%s%s\n", planned_name(scene.model->name_of(approach.label)).c_str(),
                approach.nearest_mm, pad_or_truncate(requested, 8).c_str(),
                pad_or_truncate(!approach.requested_mm       ? ""
                                : approach.is_within_limit() ? "kept"
                                                             : "NOT KEPT",
                                10)
                    .c_str(),
                std::isnan(approach.nearest_mm) ? "" : at_tick(approach.nearest).c_str());
  }
  for (const ClearanceViolation& violation : made.violations)
    std::printf("  %.2f mm from %s (%g required): ticks %llu to %llu, nearest %s\n", violation.nearest_mm,
                printable_name(scene.model->name_of(violation.label)).c_str(), violation.requested_mm,
                static_cast<unsigned long long>(violation.begin.tick),
                static_cast<unsigned long long>(violation.last_tick), at_tick(violation.nearest).c_str());
  if (made.omitted_violations > 0)
    std::printf("  and %llu more\n", static_cast<unsigned long long>(made.omitted_violations));
  if (made.cut_short) std::printf("the recording was cut short: what followed is unknown\n");
  if (made.missing_s > 0) std::printf("%.3f s are missing because ticks were dropped\n", made.missing_s);
  std::printf("%s\n", made.is_within_limit() ? "KEPT: all requirements of the plan"
                                             : "NOT KEPT: a requirement of the plan");
}

int compare(const PlanOptions& options, Console& console) {
  const auto plan = load_plan(options.plan);
  if (!plan) return console.fail(plan.error());
  const Progress progress = console.progress();
  const auto recording = RecordingSource::open(options.recording, progress);
  if (!recording) return console.fail(recording.error());
  const RecordingHeader& header = recording->head().header;
  std::optional<OutputClaim> claim;
  if (!options.json.empty()) {
    auto inputs = recorded_inputs(options.source, header);
    inputs.push_back(options.recording);
    inputs.push_back(options.plan);
    auto claimed = claim_output(options.json, inputs);
    if (!claimed) return console.fail(claimed.error());
    claim.emplace(std::move(*claimed));
  }
  const auto loaded = load_scene_of_recording(header, options.source, progress, console.warn());
  if (!loaded) return console.fail(loaded.error());
  const auto scene = scene_of_plan(*plan, loaded->model, console);
  if (!scene) return console.fail(scene.error());
  const auto made = compare_run(*scene, *recording, options.recording.string(),
                                static_cast<std::size_t>(options.device - 1), console);
  if (!made) return console.fail(made.error());
  if (!options.json.empty()) {
    const std::string text = json_of(*scene, *made).dump(2) + "\n";
    if (const auto written = write_file(options.json, text); !written) return console.fail(written.error());
    console.note("comparison: " + options.json.string());
  }
  print_comparison(*scene, *made);
  return made->is_within_limit() ? kExitOk : kExitLimit;
}

}  // namespace

void add_plan(CLI::App& app, Run& run) {
  auto options = std::make_shared<PlanOptions>();
  CLI::App* verb = app.add_subcommand("plan", "Rehearsal: show a plan, and compare a recording with it");
  verb->require_subcommand(1);
  const auto when = [&run, options](CLI::App* sub, int (*what)(const PlanOptions&, Console&)) {
    sub->callback([options, &run, what] {
      run = [options, what](Console& console) { return what(*options, console); };
    });
  };

  CLI::App* markups = verb->add_subcommand("from-markups", "Create a plan from 3D Slicer markups");
  markups
      ->add_option(
          "markups", options->markups,
          "Markups of 3D Slicer (.mrk.json): lines from entry to target, or points called Entry and Target")
      ->required();
  markups->add_option("-o,--output", options->output, "Plan to write (TOML)")->required();
  markups->add_option("--title", options->title, "Title of the plan; default: Plan")->default_val("Plan");
  markups->footer(
      "Example: palpate plan from-markups tunnel.mrk.json -o plan.toml\n\n"
      "Curves, regions of interest and planes are refused. Add tolerances, regions to remove and structures "
      "to\n"
      "keep away from to the plan by hand: palpate plan keys lists every key.");
  when(markups, from_markups);

  verb->add_subcommand("keys", "Print every key of a plan file as Markdown tables")->callback([&run] {
    run = [](Console&) { return print_result(plan_keys()); };
  });

  CLI::App* show =
      verb->add_subcommand("show", "Show the requirements of a plan, and check it against a scene");
  show->add_option("plan", options->plan, "Plan file")->required();
  show->add_option("--scene", options->source.target, kTargetHelp);
  add_volume_option(*show, options->source.volume);
  add_content_options(*show);
  show->footer(
      "Examples:\n"
      "  palpate plan show plan.toml\n"
      "  palpate plan show plan.toml --scene knee-phantom\n\n"
      "With a scene it shows the structures along each trajectory, the distance to structures to keep away "
      "from,\n"
      "and the volume to remove.");
  when(show, show_plan);

  CLI::App* comparison = verb->add_subcommand("compare", "Compare a recording with a plan");
  comparison->add_option("recording", options->recording, "Recording made by palpate simulate or explore")
      ->required();
  comparison->add_option("-p,--plan", options->plan, "Plan file")->required();
  comparison->add_option("--scene", options->source.target,
                         "Scene file or volume of the recording; not needed for data sets");
  add_volume_option(*comparison, options->source.volume);
  add_content_options(*comparison);
  comparison
      ->add_option("--device", options->device, "Number of the device whose tool is compared; default: 1")
      ->check(whole_between(1, kMaxDevices));
  comparison->add_option("--json", options->json,
                         "File to write every figure to, including distances over time (JSON)");
  comparison->footer(
      "Examples:\n"
      "  palpate plan compare run.h5 --plan plan.toml\n"
      "  palpate plan compare run.h5 --plan plan.toml --scene scene.toml --json done.json\n"
      "  palpate report run.h5 --plan plan.toml                 the same figures in the page\n\n"
      "Exit code 3: a requirement of the plan was violated, the recording was cut short, or ticks are "
      "missing.\n"
      "docs/guide/rehearsal.md defines each figure.");
  when(comparison, compare);
}

}  // namespace palpate::app
