#include "palpate/scene.h"

#include <algorithm>
#include <cstdio>
#include <set>

#include "palpate/volume_io.h"
#include "verb.h"

namespace palpate::app {
namespace {

namespace fs = std::filesystem;

// ---- scene new ----------------------------------------------------------------------------------

struct NewOptions {
  std::vector<std::string> files;  ///< LABELS, or SCAN LABELS
  std::string scan, labels, names, side, title, output;
};

/// The positional files take the places that --scan and --labels leave.
Result<void> assign_files(NewOptions& options) {
  for (auto file = options.files.rbegin(); file != options.files.rend(); ++file) {
    std::string& place = options.labels.empty() ? options.labels : options.scan;
    if (!place.empty()) {
      return Error{ErrorKind::kUsage, "more files than a scan and a label map", "scene new",
                   "palpate scene new SCAN LABELS"};
    }
    place = *file;
  }
  if (options.scan.empty() && options.labels.empty()) {
    return Error{
        ErrorKind::kUsage, "no file to write a scene for", "scene new",
        "palpate scene new SCAN LABELS, or palpate scene new LABELS, or palpate scene new --scan SCAN"};
  }
  return {};
}

Side side_of(const std::string& text) {
  return text == "left" ? Side::kLeft : text == "right" ? Side::kRight : Side::kUnknown;
}

/// Warns when a scan and its labels do not lie on one grid: the session will resample.
void compare_grids(const GridGeometry& scan, const GridGeometry& labels, Console& console) {
  if (!scan.same_grid(labels))
    console.note("The scan and the labels are on different grids; they will be resampled.");
}

int run_new(NewOptions options, Console& console) {
  if (const auto assigned = assign_files(options); !assigned) return console.fail(assigned.error());
  NewSceneInput input;
  input.title = options.title;
  input.side = side_of(options.side);
  if (!options.names.empty()) input.names = options.names;

  // the files are read whole, so that a scene is only written for what can be used
  std::optional<ScanFile> scan;
  std::optional<LabelFile> labels;
  if (!options.scan.empty()) {
    auto read = read_scan(options.scan, console.progress(), console.warn());
    if (!read) return console.fail(read.error());
    scan = std::move(*read);
    input.scan = options.scan;
    input.scan_volume = &scan->scan;
  }
  if (!options.labels.empty()) {
    auto read = read_labels(options.labels, input.names, console.progress(), console.warn());
    if (!read) return console.fail(read.error());
    labels = std::move(*read);
    input.labels = options.labels;
    input.label_map = &labels->labels;
  }
  if (scan && labels) compare_grids(scan->scan.geometry(), labels->labels.geometry(), console);

  const auto text = new_scene_text(input, fs::path(options.output).parent_path());
  if (!text) return console.fail(text.error());
  const auto scene = parse_scene(*text, options.output.empty() ? "the new scene" : options.output);
  if (!scene) return console.fail(scene.error());
  if (std::none_of(scene->tissues.begin(), scene->tissues.end(),
                   [](const auto& tissue) { return tissue.felt; }))
    console.note(
        "No name suggests a preset, so nothing is felt yet: set felt = true and a stiffness where you want "
        "it.");
  if (options.output.empty()) {
    std::fwrite(text->data(), 1, text->size(), stdout);
    return kExitOk;
  }
  if (const auto written = write_scene_text(options.output, *text); !written)
    return console.fail(written.error());
  console.note("Wrote " + options.output + " with " + std::to_string(scene->tissues.size()) +
               (scene->tissues.size() == 1 ? " tissue." : " tissues."));
  return kExitOk;
}

void add_new(CLI::App& app, Run& run) {
  const auto options = std::make_shared<NewOptions>();
  CLI::App* verb = app.add_subcommand("new", "Write a scene file for a scan, a label map, or both");
  verb->add_option("files", options->files, "The scan and its label map, or a label map alone")
      ->expected(0, 2)
      ->option_text("[SCAN] LABELS");
  verb->add_option("-s,--scan", options->scan, "The scan; alone it gives a scene by threshold");
  verb->add_option("-l,--labels", options->labels, "The label map");
  verb->add_option("-n,--names", options->names, "Names and colours of the labels (.ctbl, .tsv)");
  verb->add_option("--side", options->side, "Side of the body")->check(CLI::IsMember({"left", "right"}));
  verb->add_option("-t,--title", options->title, "Title, shown in reports");
  verb->add_option("-o,--output", options->output,
                   "The scene file; without it the text goes to standard output");
  verb->footer(
      "Examples:\n"
      "  palpate scene new scan.nii.gz labels.nii.gz -o scene.toml\n"
      "  palpate scene new knee.seg.nrrd --side left -o scene.toml\n"
      "  palpate scene new --scan ct.nii.gz -o scene.toml           touch what is bright");
  verb->callback(
      [options, &run] { run = [options](Console& console) { return run_new(*options, console); }; });
}

// ---- scene check --------------------------------------------------------------------------------

std::string join(const std::vector<std::string>& items) {
  std::string text;
  for (const std::string& item : items) text += (text.empty() ? "" : ", ") + item;
  return text;
}

std::string display_name(const Segment& segment) {
  return segment.name.empty() ? "label " + std::to_string(segment.id) : segment.name;
}

/// A row for each tissue: what it feels like and what it is made of.
void print_tissues(const Scene& scene, const std::vector<std::vector<LabelId>>& ids) {
  std::size_t width = 6;
  for (const TissueSettings& tissue : scene.tissues) width = std::max(width, tissue.name.size());
  std::printf("\n%-*s  felt  N/mm   friction  structures  rests on\n", static_cast<int>(width), "tissue");
  for (std::size_t i = 0; i < scene.tissues.size(); ++i) {
    const TissueSettings& tissue = scene.tissues[i];
    const std::string structures = tissue.threshold ? "threshold" : std::to_string(ids[i].size());
    std::printf("%-*s  %-4s  %-5.3g  %-8.3g  %-10s  %s\n", static_cast<int>(width), tissue.name.c_str(),
                tissue.felt ? "yes" : "no", tissue.stiffness_N_per_mm, tissue.friction_coefficient,
                structures.c_str(), join(tissue.rests_on).c_str());
  }
}

/// Structures that no tissue takes, and optional labels that the map does not have.
void print_left_over(const Scene& scene, const LabelMap& labels,
                     const std::vector<std::vector<LabelId>>& ids) {
  std::set<LabelId> taken;
  for (const auto& tissue : ids) taken.insert(tissue.begin(), tissue.end());
  std::vector<std::string> free;
  for (const Segment& segment : labels.segments) {
    if (!taken.contains(segment.id)) free.push_back(display_name(segment));
  }
  if (!free.empty()) std::printf("\nin no tissue, so not felt: %s\n", join(free).c_str());

  std::vector<std::string> empty;
  for (std::size_t i = 0; i < scene.tissues.size(); ++i) {
    if (!scene.tissues[i].threshold && ids[i].empty()) empty.push_back(scene.tissues[i].name);
  }
  if (!empty.empty()) std::printf("\noptional and absent here: %s\n", join(empty).c_str());
}

int run_check(const std::string& file, Console& console) {
  const auto scene = load_scene(file);
  if (!scene) return console.fail(scene.error());

  // the files behind it
  std::optional<GridGeometry> scan_grid;
  if (scene->scan) {
    const auto scan = read_scan(scene->resolve(*scene->scan), console.progress(), console.warn());
    if (!scan) return console.fail(scan.error());
    scan_grid = scan->header.geometry;
  }
  std::vector<std::vector<LabelId>> ids(scene->tissues.size());
  std::optional<LabelFile> labels;
  if (scene->labels) {
    std::optional<fs::path> names;
    if (scene->names) names = scene->resolve(*scene->names);
    auto read = read_labels(scene->resolve(*scene->labels), names, console.progress(), console.warn());
    if (!read) return console.fail(read.error());
    labels = std::move(*read);
    auto resolved = resolve_labels(*scene, labels->labels);
    if (!resolved) return console.fail(resolved.error());
    ids = std::move(*resolved);
  }
  if (scan_grid && labels) compare_grids(*scan_grid, labels->labels.geometry(), console);

  // what it says
  std::printf("%s: a valid scene\n", file.c_str());
  if (!scene->title.empty()) std::printf("title      %s\n", scene->title.c_str());
  std::printf("side       %s\n", scene->side == Side::kLeft    ? "left"
                                 : scene->side == Side::kRight ? "right"
                                                               : "unknown");
  std::printf("smoothing  sigma %g mm, %s, %d bits\n", scene->preparation.sigma_mm,
              scene->preparation.engine == GaussianEngine::kFourier ? "fourier" : "direct",
              scene->preparation.storage == FieldStorage::k8Bit ? 8 : 16);
  std::printf("tool       %s, %zu point%s\n", scene->tool.name.c_str(), scene->tool.points_mm.size(),
              scene->tool.points_mm.size() == 1 ? "" : "s");
  if (scene->max_force_N) std::printf("limit      %g N\n", *scene->max_force_N);
  print_tissues(*scene, ids);
  if (labels) print_left_over(*scene, labels->labels, ids);
  if (std::none_of(scene->tissues.begin(), scene->tissues.end(),
                   [](const auto& tissue) { return tissue.felt; }))
    console.warn()("nothing in this scene is felt: set felt = true on a tissue");
  return kExitOk;
}

void add_check(CLI::App& app, Run& run) {
  const auto file = std::make_shared<std::string>();
  CLI::App* verb =
      app.add_subcommand("check", "Read a scene and the files that it names, and say what is in it");
  verb->add_option("scene", *file, "The scene file")->required();
  verb->footer("Examples:\n  palpate scene check scene.toml");
  verb->callback([file, &run] { run = [file](Console& console) { return run_check(*file, console); }; });
}

// ---- scene keys ---------------------------------------------------------------------------------

int run_keys(bool script) {
  const std::string text =
      script ? script_keys() : scene_keys() + "\n### Presets\n\n" + tissue_preset_table();
  std::fwrite(text.data(), 1, text.size(), stdout);
  return kExitOk;
}

void add_keys(CLI::App& app, Run& run) {
  const auto script = std::make_shared<bool>(false);
  CLI::App* verb =
      app.add_subcommand("keys", "Print every key with default, unit and range, and the presets");
  verb->add_flag("--script", *script, "The keys of a palpation script instead");
  verb->footer("Examples:\n  palpate scene keys\n  palpate scene keys --script");
  verb->callback([script, &run] { run = [script](Console&) { return run_keys(*script); }; });
}

}  // namespace

void add_scene(CLI::App& app, Run& run) {
  CLI::App* verb = app.add_subcommand("scene", "Write a scene file, check one, or list what it may hold");
  verb->require_subcommand(1);
  verb->footer(
      "Examples:\n"
      "  palpate scene new scan.nii.gz labels.nii.gz -o scene.toml\n"
      "  palpate scene check scene.toml\n"
      "  palpate scene keys");
  add_new(*verb, run);
  add_check(*verb, run);
  add_keys(*verb, run);
}

}  // namespace palpate::app
