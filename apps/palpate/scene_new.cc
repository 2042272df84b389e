#include <algorithm>
#include <set>
#include <utility>

#include "apps/command/text.h"
#include "input_files.h"
#include "palpate/base/output.h"
#include "palpate/base/printable.h"
#include "palpate/device/rendered_stiffness.h"
#include "palpate/loading/loading.h"
#include "palpate/scene/named_values.h"
#include "palpate/scene/new_scene.h"
#include "palpate/scene/scene.h"
#include "palpate/surfaces/ramps.h"
#include "palpate/volume_io/volume_io.h"
#include "scene_data.h"
#include "scene_options.h"
#include "scene_verbs.h"
#include "scene_warnings.h"

namespace palpate::app {
namespace {

namespace fs = std::filesystem;

struct SceneNewOptions {
  std::vector<std::string> files;  ///< Positional arguments: LABELS, or SCAN LABELS
  std::string scan, labels, side, modality, title, law, output;
  std::optional<fs::path> names;
  std::optional<int> volume;
  bool force = false;
  bool embed = false;
  bool one_file = false;  ///< Whether a single file was given whose kind is not stated
};

/// Assigns the positional files to scan and labels that --scan and --labels leave open; two files are a scan
/// and its label map in either order.
Result<void> assign_files(SceneNewOptions& options) {
  if (options.files.size() == 2 && options.scan.empty() && options.labels.empty()) {
    auto files = identify_scan_and_labels(options.files[0], options.files[1], options.names);
    if (!files) return files.error();
    options.scan = files->scan.string();
    options.labels = files->labels.string();
    return {};
  }
  options.one_file = options.files.size() == 1 && options.scan.empty() && options.labels.empty();
  for (auto file = options.files.rbegin(); file != options.files.rend(); ++file) {
    std::string& file_option = options.labels.empty() ? options.labels : options.scan;
    if (!file_option.empty()) {
      return Error{ErrorKind::kUsage, "more files than a scan and a label map", "scene new",
                   "palpate scene new SCAN LABELS"};
    }
    file_option = *file;
  }
  if (options.scan.empty() && options.labels.empty()) {
    return Error{
        ErrorKind::kUsage, "no scan and no label map given", "scene new",
        "palpate scene new SCAN LABELS, or palpate scene new LABELS, or palpate scene new --scan SCAN"};
  }
  if (!options.scan.empty() && !options.labels.empty() && same_file(options.scan, options.labels)) {
    return Error{ErrorKind::kUsage, "the same file is given as the scan and as the label map", options.scan,
                 "give the label map alone, or its scan before it"};
  }
  return {};
}

/// Claims the output. A scene file contains manual work, so an existing one is not replaced without --force,
/// and the input data never.
Result<std::optional<OutputClaim>> check_new_output(const SceneNewOptions& options) {
  using Claim = std::optional<OutputClaim>;
  if (options.output.empty()) return Claim();
  std::vector<fs::path> inputs;
  for (const std::string& input : {options.scan, options.labels})
    if (!input.empty()) add_input(input, inputs);
  if (options.names) add_input(*options.names, inputs);
  auto claimed = claim_output(options.output, inputs);
  if (!claimed) return claimed.error();
  std::error_code unknown;
  if (!options.force && fs::exists(options.output, unknown))
    return Error{ErrorKind::kUsage, "the file exists", options.output,
                 "write to another file, or replace it with --force"};
  return Claim(*std::move(claimed));
}

/// Notes the structures whose names suggest no preset, in one line: they remain for the user to fill in.
void note_without_preset(const Scene& scene, Console& console) {
  constexpr std::size_t kNamed = 12;
  std::size_t all = 0, unknown = 0;
  std::string names;
  for (const TissueSettings& tissue : scene.tissues) {
    all += tissue.labels.size();
    if (tissue.touchable) continue;
    // structures are listed instead of tissues, because a tissue may combine many of them
    for (const LabelReference& label : tissue.labels) {
      if (++unknown > kNamed) continue;
      const auto* number = std::get_if<int>(&label);
      names += (names.empty() ? "" : ", ") +
               (number ? "label " + std::to_string(*number) : std::get<std::string>(label));
    }
  }
  if (unknown == 0) return;
  if (unknown > kNamed) names += " and " + std::to_string(unknown - kNamed) + " more";
  if (unknown == all)
    console.note("No name matches a preset, so no tissue is touchable yet (" + names +
                 "): set touchable = true, with a preset or a stiffness, on the tissues to feel, or name the "
                 "labels with --names.");
  else
    console.note(std::to_string(unknown) + " of " + std::to_string(all) +
                 " structures match no preset and are not touchable yet: " + names);
}

/// Selects the volume of a study on which its segmentation was made, and the segmentation if it lies in the
/// folder of the study.
Result<void> match_study(SceneNewOptions& options, Console& console) {
  if (options.labels.empty()) return {};
  const std::string& scan = options.one_file ? options.labels : options.scan;
  if (scan.empty()) return {};
  const std::optional<fs::path> labels =
      options.one_file ? std::nullopt : std::optional<fs::path>(options.labels);
  const auto study = find_study(scan, labels, options.volume, console.progress());
  if (!study) return study.error();
  if (!study->labels) return {};
  for (const std::string& note : study->notes) console.note(note);
  options.one_file = false;
  options.scan = study->scan.string();
  options.labels = study->labels->string();
  options.volume = study->volume;
  return {};
}

/// Stores the placement options in the scene, so that its files are read in the same way the next time.
void print_placement_options(const PlacementOptions& placement_options, NewSceneInput& input) {
  input.image_spacing_mm = placement_options.image_spacing_mm;
  if (placement_options.nifti_form)
    input.nifti_form =
        *placement_options.nifti_form == NiftiForm::kQform ? HeaderForm::kQform : HeaderForm::kSform;
  input.scan_is_cropped = placement_options.scan_is_cropped;
  if (!input.labels) return;
  if (placement_options.mesh.space)
    input.mesh_space =
        *placement_options.mesh.space == MeshSpace::kRas ? SurfaceAxes::kRas : SurfaceAxes::kLps;
  if (placement_options.mesh.unit_mm)
    input.mesh_unit = *placement_options.mesh.unit_mm == 1    ? SurfaceUnit::kMm
                      : *placement_options.mesh.unit_mm == 10 ? SurfaceUnit::kCm
                                                              : SurfaceUnit::kM;
}

int run_new(SceneNewOptions options, Console& console) {
  if (const auto assigned = assign_files(options); !assigned) return console.fail(assigned.error());
  const auto claimed = check_new_output(options);
  if (!claimed) return console.fail(claimed.error());
  if (const auto matched = match_study(options, console); !matched) return console.fail(matched.error());

  NewSceneInput input;
  input.title = options.title;
  input.side = value_of(options.side, kSides);
  input.modality = value_of(options.modality, kModalities);
  if (!options.law.empty()) input.law = value_of(options.law, kTissueLaws);
  if (!options.scan.empty()) input.scan = options.scan;
  if (!options.labels.empty()) input.labels = options.labels;
  input.names = options.names;
  input.volume_of_scan = options.volume;
  print_placement_options(placement_options(), input);
  input.embed = options.embed;
  const auto data = options.one_file
                        ? read_one(*input.labels, options.volume, input.names, console)
                        : read_data(input.scan, options.volume, input.labels, input.names, {}, console);
  if (!data) return console.fail(data.error());
  if (options.one_file && data->scan) std::swap(input.scan, input.labels);
  if (options.embed && !data->labels)
    return console.fail({ErrorKind::kUsage, "there are no structures to embed without a label map", "--embed",
                         "give the label map as well, or leave the option out"});
  if (const auto grids = compare_grids(*data, options.labels, placement_options().scan_is_cropped, console);
      !grids) {
    Error error = grids.error();
    error.where = options.labels;
    return console.fail(error);
  }
  if (data->scan) input.scan_volume = &data->scan->scan;
  if (data->labels) {
    input.label_map = &data->labels->labels;
    input.names_from = description_of(data->labels->name_source);
    // the table of names is stored in the scene, which is then independent of other files in the folder
    if (!input.names) input.names = data->labels->names_table;
    console.note(origin_of_names(*data->labels));
  }
  if (data->scan && resembles_labels(*data->scan))
    console.warn()(options.scan + " looks like a label map, not a scan: give it last, or after --labels");

  const auto text = new_scene_text(input, fs::path(options.output).parent_path());
  if (!text) return console.fail(text.error());
  const auto scene = parse_scene(*text, options.output.empty() ? "the new scene" : options.output);
  if (!scene) return console.fail(scene.error());
  note_without_preset(*scene, console);
  warn_if_nothing_deforms(*scene, console);
  if (options.output.empty()) return print_result(*text);
  if (const auto written = write_scene_text(options.output, *text); !written)
    return console.fail(written.error());
  console.note("Wrote " + options.output + " with " + std::to_string(scene->tissues.size()) +
               (scene->tissues.size() == 1 ? " tissue." : " tissues."));
  return kExitOk;
}

/// Formatter that prints the description of a positional in the usage line, where CLI11 would print
/// "[files(0x)]".
class PositionalTextFormatter : public CLI::Formatter {
 public:
  std::string make_option_usage(const CLI::Option* option) const override {
    const std::string& text = option->get_option_text();
    return text.empty() ? Formatter::make_option_usage(option) : text;
  }
};

/// Names of an enumeration, without that of kUnknown.
template <class Enum, std::size_t N>
std::vector<std::string> known_names(const std::array<NamedValue<Enum>, N>& words) {
  std::vector<std::string> names;
  for (const auto& [value, name] : words)
    if (value != Enum::kUnknown) names.emplace_back(name);
  return names;
}

}  // namespace

void add_scene_new(CLI::App& app, Run& run) {
  const auto options = std::make_shared<SceneNewOptions>();
  CLI::App* verb = app.add_subcommand("new", "Write a scene file for a scan, a label map, or both");
  verb->formatter(std::make_shared<PositionalTextFormatter>());
  verb->add_option("files", options->files,
                   "The scan and its label map, one of them alone, or a DICOM folder that holds both")
      ->expected(0, 2)
      ->option_text("[SCAN] LABELS");
  verb->add_option("-s,--scan", options->scan, "The scan; without labels the scene uses a threshold");
  verb->add_option("-l,--labels", options->labels, "The label map");
  add_names_option(*verb, options->names);
  add_volume_option(*verb, options->volume);
  verb->add_option("--side", options->side, "Side of the body: left, right, or both for a head or a torso")
      ->check(CLI::IsMember(known_names(kSides)));
  verb->add_option("--modality", options->modality,
                   "Modality of the scan: the viewer shows ct in HU, mr with windows by its range of values")
      ->check(CLI::IsMember(known_names(kModalities)));
  verb->add_option("--tissue", options->law,
                   "Soft-tissue model: layers push the tool out and do not move; elastic deforms (default if "
                   "a name suggests soft tissue); neo-hookean also stiffens under large strain; "
                   "exponential stiffens by each tissue's exponent as well; chainmail feels like layers, and "
                   "its deformation is shown")
      ->check(CLI::IsMember(
          {name_of(TissueLaw::kLayers, kTissueLaws), name_of(TissueLaw::kElastic, kTissueLaws),
           name_of(TissueLaw::kNeoHookean, kTissueLaws), name_of(TissueLaw::kExponential, kTissueLaws),
           name_of(TissueLaw::kChainMail, kTissueLaws)}));
  verb->add_flag("--embed", options->embed,
                 "Embed the structures: unlabelled tissue inside the body becomes a separate soft medium");
  verb->add_option("-t,--title", options->title, "Title, shown in reports");
  verb->add_option("-o,--output", options->output, "Scene file to write; default: standard output");
  verb->add_flag("-f,--force", options->force, "Replace the scene file if it exists");
  verb->footer(
      "Examples:\n"
      "  palpate scene new scan.nii.gz labels.nii.gz -o scene.toml\n"
      "  palpate scene new knee.seg.nrrd --side left -o scene.toml\n"
      "  palpate scene new STUDY seg.dcm -o scene.toml              a folder of DICOM and its segmentation\n"
      "  palpate scene new ct.nii.gz organs.nii.gz --embed -o scene.toml  soft tissue between the organs\n"
      "  palpate scene new --scan ct.nii.gz -o scene.toml           bright parts of the scan\n"
      "  palpate scene new --scan FOLDER --volume 2 -o scene.toml   second DICOM volume (palpate info)");
  verb->callback(
      [options, &run] { run = [options](Console& console) { return run_new(*options, console); }; });
}

}  // namespace palpate::app
