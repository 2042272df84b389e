#include <algorithm>
#include <array>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <limits>

#include "input_files.h"
#include "leak_text.h"
#include "palpate/base/output.h"
#include "palpate/base/reading.h"
#include "palpate/catalog/catalog.h"
#include "palpate/loading/loading.h"
#include "palpate/preparation/preparation.h"
#include "palpate/surfaces/surfaces.h"
#include "palpate/volume_io/volume_io.h"
#include "scene_options.h"
#include "verb.h"

namespace palpate::app {
namespace {

constexpr const char* kPrepareExamples =
    "Examples:\n"
    "  palpate prepare knee.seg.nrrd -o field.nrrd --sigma 1.5\n"
    "  palpate prepare ct.nii.gz --threshold 150 400 -o bone.nrrd --bits 8\n"
    "  palpate prepare labels.nrrd -o field.nrrd --engine fourier --compare\n"
    "  palpate prepare scene.toml -o field.nrrd             field of the scene's direct methods\n"
    "  palpate prepare STUDY seg.dcm -o field.nrrd          field of the scene proposed for both\n\n"
    "A label map is smoothed with every label at full weight. A scene file, a data set and a scan with its\n"
    "segmentation define their own tissues, sigma, engine and bits. The field is written in the geometry of "
    "the file: 0 is\n"
    "free space, 255 or 65535 the inside of the stiffest tissue. The proxy, the default method, uses "
    "surfaces\n"
    "of the labels instead of a field.";

struct PrepareOptions {
  SceneSource source;
  std::string output;
  double sigma_mm = 1.0;
  std::string engine = "direct";
  int bits = 16;
  std::vector<double> threshold;
  int threads = 0;
  bool compare = false;
  std::string settings;  // options given that a scene determines itself: "--sigma, --bits"
};

using FieldVolume = std::variant<Volume<std::uint8_t>, Volume<std::uint16_t>>;

GaussianOptions gaussian_options(const PrepareOptions& options) {
  const auto engine = options.engine == "fourier" ? GaussianEngine::kFourier : GaussianEngine::kDirect;
  return {.sigma_mm = options.sigma_mm, .engine = engine, .threads = options.threads};
}

/// Whether the target is a scene (a data set or a scene file) or a scan with its segmentation, for which a
/// scene is proposed.
Result<bool> is_scene_target(const PrepareOptions& options, const Progress& progress) {
  const SceneSource& source = options.source;
  if (find_entry(source.target).ok() || std::filesystem::path(source.target).extension() == ".toml")
    return true;
  if (source.segmentation) return true;
  if (!options.threshold.empty()) return false;
  const auto study = find_study(source.target, {}, source.volume, progress);
  if (!study) return study.error();
  return study->labels.has_value();
}

/// Warns of places where a tool would slip through the surface of touchable structures. Errors:
/// kInterrupted.
Result<void> warn_of_leaks(const Bricks<LabelId>& labels, const std::vector<LabelId>& touchable,
                           const std::function<std::string(LabelId)>& name_of, Console& console) {
  const auto leaks = find_leaks(labels, touchable, 0, console.progress());
  if (!leaks) return leaks.error();
  if (!leaks->empty()) console.warn()(describe_leaks(*leaks, name_of));
  return {};
}

/// Weights before smoothing: full weight for every label, or the ramp on a scan.
Result<Volume<std::uint8_t>> read_weights(const PrepareOptions& options, Console& console) {
  if (!options.threshold.empty()) {
    const auto file = read_scan(options.source.target, console.progress(), console.warn(), VoxelCaching::kOff,
                                options.source.volume);
    if (!file) return file.error();
    return ramp_scan(file->scan, options.threshold[0], options.threshold[1]);
  }
  if (read_as() == ReadAs::kScan)
    return Error{ErrorKind::kUsage, "a scan needs a threshold to become a field", "--scan",
                 "add --threshold LOW HIGH"};
  const AmbiguousLabels ambiguous =
      read_as() == ReadAs::kLabels ? AmbiguousLabels::kWarn : AmbiguousLabels::kReject;
  const auto file =
      read_labels(options.source.target, options.source.names, console.progress(), console.warn(), ambiguous);
  if (!file) {
    Error error = file.error();
    if (error.kind == ErrorKind::kBadInput && read_header(options.source.target).ok()) {
      error.remedy += (error.remedy.empty() ? "" : "; ") +
                      std::string(
                          "a scan without segmentation needs --threshold LOW HIGH, or a scene: palpate "
                          "scene new --scan ") +
                      options.source.target + " -o scene.toml";
    }
    return error;
  }
  console.note(origin_of_names(*file));
  std::vector<LabelId> all;
  for (const Segment& segment : file->labels.segments) all.push_back(segment.id);
  const auto name_of = [&](LabelId id) {
    const std::string& name = file->labels.find(id)->name;
    return name.empty() ? "label " + std::to_string(id) : name;
  };
  const Volume<LabelId> labels = file->labels.flattened();
  if (auto warned = warn_of_leaks(*label_bricks(labels), all, name_of, console); !warned)
    return warned.error();
  std::vector<std::uint8_t> weights(std::size_t{std::numeric_limits<LabelId>::max()} + 1, 255);
  weights[0] = 0;
  return weigh_labels(labels, weights);
}

Result<FieldVolume> smooth(const Volume<std::uint8_t>& weights, const PrepareOptions& options,
                           Console& console) {
  if (options.bits == 8) {
    auto field = gaussian_smooth(weights, gaussian_options(options), console.progress());
    if (!field) return field.error();
    return FieldVolume(*std::move(field));
  }
  auto field = gaussian_smooth_16(weights, gaussian_options(options), console.progress());
  if (!field) return field.error();
  return FieldVolume(*std::move(field));
}

Result<void> write(const std::string& output, const FieldVolume& field) {
  return std::visit([&](const auto& volume) { return write_volume(output, volume); }, field);
}

const GridGeometry& geometry_of(const FieldVolume& field) {
  return std::visit([](const auto& volume) -> const GridGeometry& { return volume.geometry(); }, field);
}

/// Prints the grid, the smoothing or ramp width and the bit depth of a field.
/// @param ramp_width_mm  width of the inward ramp; 0: the field is smoothed with sigma
void print_field(const FieldVolume& field, double sigma_mm, double ramp_width_mm) {
  const GridGeometry& grid = geometry_of(field);
  const Eigen::Vector3d sigma = grid.spacing_mm.cwiseInverse() * sigma_mm;
  std::printf("grid      %d x %d x %d voxels, %.4g x %.4g x %.4g mm\n", grid.dims[0], grid.dims[1],
              grid.dims[2], grid.spacing_mm[0], grid.spacing_mm[1], grid.spacing_mm[2]);
  if (ramp_width_mm > 0)
    std::printf("ramps     %.4g mm wide, 0 outside\n", ramp_width_mm);
  else
    std::printf("sigma     %.4g mm: %.3g x %.3g x %.3g voxels\n", sigma_mm, sigma[0], sigma[1], sigma[2]);
  std::printf("field     %d bits\n", field.index() == 0 ? 8 : 16);
}

int compare_engines(const Volume<std::uint8_t>& weights, const PrepareOptions& options, Console& console) {
  const auto difference = compare_gaussian_engines(weights, options.sigma_mm, console.progress());
  if (!difference) return console.fail(difference.error());
  std::printf("engines   differ by at most %.4f of 255 before rounding, %.6f on average\n",
              difference->max_abs, difference->mean_abs);
  const auto& sigma = difference->sigma_voxels;
  if (*std::min_element(sigma.begin(), sigma.end()) < 1.5) {
    std::printf("          (sigma is less than 1.5 voxels on an axis: the engines need not agree there)\n");
  }
  return kExitOk;
}

int prepare_file(const PrepareOptions& options, Console& console) {
  const auto weights = read_weights(options, console);
  if (!weights) return console.fail(weights.error());
  if (options.compare) {
    if (const int failed = compare_engines(*weights, options, console); failed != kExitOk) return failed;
  }
  const auto field = smooth(*weights, options, console);
  if (!field) return console.fail(field.error());
  if (const auto written = write(options.output, *field); !written) return console.fail(written.error());
  print_field(*field, options.sigma_mm, 0);
  return kExitOk;
}

int prepare_scene(const PrepareOptions& options, Console& console) {
  if (!options.settings.empty()) {
    return console.fail({ErrorKind::kUsage, "is for one volume only: a scene defines its own preparation",
                         options.settings,
                         "leave it out, or give a volume; a scene file has sigma, engine and bits under "
                         "[preparation]"});
  }
  const auto print_memory = [](const SceneMemory& memory) {
    const std::uint64_t beside = memory.scan + memory.model.labels;
    std::printf(
        "memory    up to %s, of which the field keeps %s\n",
        memory_size_text(std::max(memory.read + memory.model.labels, beside + memory.model.peak_of_field))
            .c_str(),
        memory_size_text(memory.model.field).c_str());
    std::fflush(stdout);
  };
  // a scene rendered by the proxy is loaded without the field
  SceneMemory without_field;
  const auto report_memory = [&](const SceneMemory& memory) {
    if (memory.model.peak_of_field > 0)
      print_memory(memory);
    else
      without_field = memory;
  };
  const auto loaded = load_touchable_target(options.source, console, {}, report_memory);
  if (!loaded) return console.fail(loaded.error());
  const Model& model = *loaded->model;
  std::vector<LabelId> touchable;
  for (std::size_t label = 1; label < model.tissue_of_label.size(); ++label)
    if (model.is_touchable(static_cast<LabelId>(label))) touchable.push_back(static_cast<LabelId>(label));
  const auto name_of = [&](LabelId id) { return model.name_of(id); };
  if (auto warned = warn_of_leaks(*model.labels, touchable, name_of, console); !warned)
    return console.fail(warned.error());
  if (model.field == nullptr) {
    const FieldMemory of_field = memory_of_ramp_field(model);
    without_field.model.field = of_field.permanent;
    without_field.model.peak_of_field = of_field.peak;
    print_memory(without_field);
  }
  const auto ready =
      prepared_with_cache(loaded->model, std::array{ForceMethod::kTrilinear}, console.progress());
  if (!ready) return console.fail(ready.error());
  const FieldVolume& field = (*ready)->field->storage();
  if (const auto written = write(options.output, field); !written) return console.fail(written.error());
  print_field(field, model.sigma_mm, model.ramp_width_mm);
  return kExitOk;
}

// Whether 3D Slicer would interpret the values of a file of that name as labels.
bool is_segmentation_name(std::string name) {
  std::transform(name.begin(), name.end(), name.begin(),
                 [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; });
  return name.ends_with(".seg.nrrd");
}

int run_prepare(const PrepareOptions& options, Console& console) {
  if (is_segmentation_name(options.output)) {
    return console.fail({ErrorKind::kUsage,
                         "is the name of a segmentation, but a field is not a segmentation", options.output,
                         "name it .nrrd without .seg, .nii.gz or .mha"});
  }
  const auto claimed = claim_output(options.output, input_files(options.source));
  if (!claimed) return console.fail(claimed.error());
  const auto is_scene = is_scene_target(options, console.progress());
  if (!is_scene) return console.fail(is_scene.error());
  if (*is_scene) return prepare_scene(options, console);
  if (!options.threshold.empty() && !(options.threshold[0] < options.threshold[1])) {
    return console.fail({ErrorKind::kUsage, "the first threshold must be below the second", "--threshold",
                         "give the value at which tissue begins, then the value of full tissue"});
  }
  return prepare_file(options, console);
}

}  // namespace

void add_prepare(CLI::App& app, Run& run) {
  auto options = std::make_shared<PrepareOptions>();
  CLI::App* verb =
      app.add_subcommand("prepare", "Prepare the field that the direct methods read from labels or a scan");
  verb->footer(kPrepareExamples);
  add_source_options(*verb, options->source)->required();
  verb->add_option("-o,--output", options->output, "field to write: .nrrd, .nii.gz or .mha")->required();

  constexpr const char* kForVolumes =
      "For one volume; a scene, a data set or a scan with its segmentation defines its own";
  verb->add_option("-s,--sigma", options->sigma_mm, "Width of the Gaussian in mm")
      ->group(kForVolumes)
      ->check(number_between(0, 10))
      ->capture_default_str();
  verb->add_option("-e,--engine", options->engine, "direct convolution, or the published Fourier filter")
      ->group(kForVolumes)
      ->check(CLI::IsMember({"direct", "fourier"}))
      ->capture_default_str();
  verb->add_option("-b,--bits", options->bits, "bits per voxel: 8 as published, 16 for finer directions")
      ->group(kForVolumes)
      ->check(CLI::IsMember({8, 16}))
      ->capture_default_str();
  verb->add_option("-t,--threshold", options->threshold, "scan value of free space, and of full tissue")
      ->group(kForVolumes)
      ->expected(2)
      ->check(number_between(-1e9, 1e9))
      ->type_name("LOW HIGH");
  verb->add_option("-j,--threads", options->threads, "Number of threads; 0: all processors")
      ->group(kForVolumes)
      ->check(whole_between(0, 1024))
      ->capture_default_str();
  verb->add_flag("-c,--compare", options->compare, "Also report the difference between the two engines")
      ->group(kForVolumes);
  verb->callback([options, verb, &run] {
    for (const CLI::Option* setting : verb->get_options())
      if (setting->get_group() == kForVolumes && setting->count() > 0)
        options->settings += (options->settings.empty() ? "" : ", ") + setting->get_name();
    run = [options](Console& console) { return run_prepare(*options, console); };
  });
}

}  // namespace palpate::app
