#include "palpate/scene/scene.h"

#include <algorithm>
#include <cstdio>
#include <set>

#include "apps/command/text.h"
#include "input_files.h"
#include "palpate/base/output.h"
#include "palpate/base/printable.h"
#include "palpate/device/rendered_stiffness.h"
#include "palpate/loading/loading.h"
#include "palpate/surfaces/ramps.h"
#include "palpate/volume_io/volume_io.h"
#include "scene_options.h"
#include "verb.h"

namespace palpate::app {
namespace {

namespace fs = std::filesystem;

// ---- input data of a scene ----------------------------------------------------------------------

/// Input volumes of a scene: a label map, a scan or both.
struct Data {
  std::optional<ScanFile> scan;
  std::optional<LabelFile> labels;

  const GridGeometry* scan_grid() const { return scan ? &scan->scan.geometry() : nullptr; }
  const GridGeometry* labels_grid() const { return labels ? &labels->labels.geometry() : nullptr; }
  /// Whether every file states its orientation in the patient.
  bool oriented() const {
    return (!scan || scan->header.has_geometry) && (!labels || labels->header.has_geometry);
  }
};

void warn_if_silent(const VolumeHeader& header, const fs::path& file, Console& console) {
  if (header.has_geometry) return;
  console.warn()(
      file.string() +
      " does not state its orientation in the patient: its axes are taken as LPS, sides are unknown");
}

/// Reads the named files completely, so that a scene is accepted only for data that can be used.
/// @param volume  number of the volume to use as the scan, if the file holds several
Result<Data> read_data(const std::optional<fs::path>& scan, std::optional<int> volume,
                       const std::optional<fs::path>& labels, const std::optional<fs::path>& names,
                       const PlacementOptions& placement_options, Console& console) {
  Data data;
  if (scan) {
    auto read =
        read_scan(*scan, console.progress(), console.warn(), VoxelCaching::kOff, volume, placement_options);
    if (!read) return read.error();
    data.scan = std::move(*read);
    warn_if_silent(data.scan->header, *scan, console);
  }
  if (labels) {
    auto read = read_labels(*labels, names, console.progress(), console.warn(), AmbiguousLabels::kReject,
                            VoxelCaching::kOff, data.scan_grid(), placement_options, scan);
    if (!read) return read.error();
    data.labels = std::move(*read);
    warn_if_silent(data.labels->header, *labels, console);
  }
  return data;
}

/// Reads a file whose kind is not stated.
Result<Data> read_one(const fs::path& file, std::optional<int> number, const std::optional<fs::path>& names,
                      Console& console) {
  auto volume = read_volume(file, names, console.progress(), console.warn(), VoxelCaching::kOff, number);
  if (!volume) return volume.error();
  Data data;
  if (auto* labels = std::get_if<LabelFile>(&*volume)) {
    warn_if_silent(labels->header, file, console);
    data.labels = std::move(*labels);
    if (!data.labels->evidence.empty())
      console.note(file.string() + " is taken as labels, because " + data.labels->evidence +
                   "; --scan takes it as a scan");
  } else {
    data.scan = std::get<ScanFile>(*std::move(volume));
    warn_if_silent(data.scan->header, file, console);
    console.note(file.string() + " is taken as a scan, felt where it is bright, because " +
                 data.scan->evidence + "; --labels takes it as a label map");
  }
  return data;
}

/// Checks scan and labels on different grids, which will be resampled onto field_grid(). Notes the fraction
/// of the labels inside the scan; an error if it is too small.
Result<void> compare_grids(const Data& data, const fs::path& labels_file, bool scan_is_cropped,
                           Console& console) {
  if (!data.scan || !data.labels) return {};
  const LabelPlacement placement = placement_of(data.labels->labels, *data.scan_grid());
  if (auto together = check_placement(placement, labels_file, scan_is_cropped); !together)
    return together.error();
  const std::string doubt = placement_warning(placement);
  doubt.empty() ? console.note(in_words(placement) + ".") : console.warn()(doubt);
  if (data.scan_grid()->same_grid(*data.labels_grid())) return {};
  if (&field_grid(data.labels_grid(), data.scan_grid()) == data.labels_grid()) {
    if (const auto moved = resample_linear(data.scan->scan, *data.labels_grid(), 0); !moved)
      return moved.error();
  } else if (const auto moved = resample_nearest(data.labels->labels, *data.scan_grid()); !moved) {
    return moved.error();
  }
  console.note("The scan and the labels are on different grids; they will be resampled.");
  return {};
}

// ---- scene new ----------------------------------------------------------------------------------

struct NewOptions {
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
Result<void> assign_files(NewOptions& options) {
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
Result<std::optional<OutputClaim>> check_new_output(const NewOptions& options) {
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

/// Warns if the law deforms tissue but no tissue is deformable.
void warn_if_nothing_deforms(const Scene& scene, Console& console) {
  if (scene.deformation.law == TissueLaw::kLayers) return;
  if (std::none_of(scene.tissues.begin(), scene.tissues.end(),
                   [](const TissueSettings& tissue) { return tissue.touchable && tissue.elastic; }))
    console.warn()(
        "no tissue in this scene yields: give a touchable tissue a youngs_modulus, or a preset that has one");
}

/// Warns of a stiffness that has no effect: deformable tissue is rendered from its modulus, and the
/// stiffness given with its preset is used by the other laws only.
void warn_of_ignored_stiffness(const Scene& scene, Console& console) {
  if (!is_elastic(scene.deformation.law)) return;
  for (const TissueSettings& tissue : scene.tissues) {
    if (!tissue.touchable || !tissue.elastic) continue;
    const TissuePreset* preset = find_preset(tissue.preset);
    if (preset == nullptr || !preset->values.elastic ||
        tissue.stiffness_N_per_mm == preset->values.stiffness_N_per_mm ||
        tissue.elastic->youngs_modulus_kPa != preset->values.elastic->youngs_modulus_kPa)
      continue;
    char modulus[32];
    std::snprintf(modulus, sizeof modulus, "%g", tissue.elastic->youngs_modulus_kPa);
    console.warn()("the stiffness of " + printable_name(tissue.name) +
                   " has no effect, because it yields: its youngs_modulus (" + modulus +
                   " kPa) is used; change that, or write law = \"layers\" under [yielding]");
  }
}

/// Selects the volume of a study on which its segmentation was made, and the segmentation if it lies in the
/// folder of the study.
Result<void> match_study(NewOptions& options, Console& console) {
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

int run_new(NewOptions options, Console& console) {
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
class UsageInWords : public CLI::Formatter {
 public:
  std::string make_option_usage(const CLI::Option* option) const override {
    const std::string& words = option->get_option_text();
    return words.empty() ? Formatter::make_option_usage(option) : words;
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

void add_new(CLI::App& app, Run& run) {
  const auto options = std::make_shared<NewOptions>();
  CLI::App* verb = app.add_subcommand("new", "Write a scene file for a scan, a label map, or both");
  verb->formatter(std::make_shared<UsageInWords>());
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

// ---- scene check --------------------------------------------------------------------------------

std::string join(const std::vector<std::string>& items) {
  std::string text;
  for (const std::string& item : items) text += (text.empty() ? "" : ", ") + item;
  return text;
}

std::string display_name(const Segment& segment) {
  return segment.name.empty() ? "label " + std::to_string(segment.id) : segment.name;
}

/// Greatest force of a direct method in a tissue of sufficient thickness.
double max_N_of(const Scene& scene, const TissueSettings& tissue, const GridGeometry& grid) {
  if (!tissue.touchable) return 0;
  if (scene.preparation.method == PreparationMethod::kUnionGaussian)
    return most_force_N(tissue, scene.preparation.sigma_mm, grid);
  double stiffest = 0;
  for (const TissueSettings& other : scene.tissues)
    if (other.touchable) stiffest = std::max(stiffest, other.stiffness_N_per_mm);
  const auto width_mm = ramp_width_mm(scene.preparation.ramp_width_mm, grid);
  return std::min(tissue.stiffness_N_per_mm * kDeepestRamp_mm, width_mm ? stiffest * *width_mm : 0);
}

/// Prints a row for each tissue with its contact properties and labels. If the workspace makes the rendered
/// stiffness s g K differ from the stiffness K of the tissue, it has a column of its own.
void print_tissues(const Scene& scene, const std::vector<std::vector<LabelId>>& ids,
                   const GridGeometry& grid) {
  std::size_t width = 6;
  for (const TissueSettings& tissue : scene.tissues) width = std::max(width, display_width(tissue.name));
  const double factor = RenderedStiffness(scene.workspace).at_device(1);
  const bool elastic = is_elastic(scene.deformation.law);
  const bool stiffens = scene.deformation.law == TissueLaw::kExponential;
  std::printf("\n%s  felt  N/mm   %s%sat most N  friction  structures  rests on\n",
              pad_or_truncate("tissue", width).c_str(),
              stiffens  ? "E kPa  nu    stiffening  "
              : elastic ? "E kPa  nu    "
                        : "",
              factor == 1 ? "" : "hand N/mm  ");
  for (std::size_t i = 0; i < scene.tissues.size(); ++i) {
    const TissueSettings& tissue = scene.tissues[i];
    const std::string structures = tissue.threshold   ? "threshold"
                                   : tissue.embedding ? "embedding"
                                                      : std::to_string(ids[i].size());
    const double max_N = max_N_of(scene, tissue, grid);
    std::printf("%s  %-4s  %-5.3g  ", pad_or_truncate(tissue.name, width).c_str(),
                tissue.touchable ? "yes" : "no", tissue.stiffness_N_per_mm);
    if (elastic && tissue.elastic)
      std::printf("%-5.3g  %-4.3g  ", tissue.elastic->youngs_modulus_kPa, tissue.elastic->poissons_ratio);
    else if (elastic)
      std::printf("rigid        ");
    if (stiffens && tissue.elastic)
      std::printf("%-10.3g  ", tissue.elastic->stiffening);
    else if (stiffens)
      std::printf("            ");
    if (factor != 1) std::printf("%-9.3g  ", tissue.touchable ? factor * tissue.stiffness_N_per_mm : 0.0);
    std::printf("%-9.3g  %-8.3g  %-10s  %s\n", max_N, tissue.friction, structures.c_str(),
                join(tissue.rests_on).c_str());
  }
  if (scene.force.method == ForceMethod::kProxy)
    std::printf("at most N: with the other methods; the proxy gives force up to the limit\n");
  if (factor != 1)
    std::printf("hand N/mm: stiffness at the hand, scale x force gain = %g times the tissue's\n", factor);
  if (scene.workspace.force_gain != 1)
    std::printf("at most N: in the patient; at the device %g times as much\n", scene.workspace.force_gain);
}

/// Side of the patient as interpreted by the program.
std::string side_text(const Scene& scene, const Data& data) {
  if (scene.side != Side::kUnknown) return std::string(name_of(scene.side, kSides));
  if (!data.oriented()) return "unknown";
  const LabelMap* labels = data.labels ? &data.labels->labels : nullptr;
  if (labels && labels->find("tibia") && labels->find("fibula"))
    return "not given: follows from the fibula, which lies lateral to the tibia";
  return "unknown; set side = \"left\", \"right\" or \"both\"";
}

/// Prints the field settings, which all methods except the proxy use.
void print_preparation(const PreparationSettings& preparation, double width_mm) {
  const int bits = preparation.storage == FieldStorage::k8Bit ? 8 : 16;
  if (preparation.method == PreparationMethod::kInwardRamp)
    std::printf("field      inward ramps, %g mm wide, %d bits\n", width_mm, bits);
  else
    std::printf("field      union Gaussian, sigma %g mm, %s, %d bits\n", preparation.sigma_mm,
                preparation.engine == GaussianEngine::kFourier ? "fourier" : "direct", bits);
}

void print_deformation(const DeformationSettings& deformation) {
  if (deformation.law == TissueLaw::kLayers) return;
  std::printf("tissue     %s", std::string(name_of(deformation.law, kTissueLaws)).c_str());
  if (deformation.cell_mm) std::printf(", cells of %g mm", *deformation.cell_mm);
  if (deformation.relaxation) std::printf(", presets relax");
  std::printf("\n");
}

/// Prints the relaxation of each relaxing tissue: "muscle: 30 % in 0.5 s, 20 % in 5 s".
void print_relaxations(const Scene& scene) {
  if (!is_elastic(scene.deformation.law)) return;
  const char* title = "relaxes";
  for (const TissueSettings& tissue : scene.tissues) {
    if (!tissue.touchable || !tissue.elastic || !tissue.relaxation.relaxes()) continue;
    std::string terms;
    for (const RelaxationTerm& term : tissue.relaxation.term) {
      if (!(term.fraction > 0)) continue;
      char text[48];
      std::snprintf(text, sizeof text, "%s%.3g %% in %.3g s", terms.empty() ? "" : ", ", 100 * term.fraction,
                    term.time_s);
      terms += text;
    }
    std::printf("%-10s %s: %s\n", title, tissue.name.c_str(), terms.c_str());
    title = "";
  }
}

/// Prints the name and shape of a tool.
void print_tool(const char* what, const Tool& tool) {
  std::printf("%-10s %s, ", what, tool.name.c_str());
  if (tool.burr)
    std::printf("%s", burr_description(tool).c_str());
  else
    std::printf("%zu point%s", tool.points_mm.size(), tool.points_mm.size() == 1 ? "" : "s");
  if (!tool.burr && tool.radius_mm > 0) std::printf(", radius %g mm", tool.radius_mm);
  for (const ToolCapsule& capsule : tool.capsules)
    std::printf(", capsule of %g mm, radius %g mm", (capsule.to_mm - capsule.from_mm).norm(),
                capsule.radius_mm);
  std::printf("\n");
}

void print_workspace(const WorkspaceSettings& workspace) {
  const WorkspaceSettings usual;
  if (workspace.scale != usual.scale || workspace.force_gain != usual.force_gain ||
      workspace.yaw_deg != usual.yaw_deg)
    std::printf("workspace  scale %g, force gain %g, yaw %g degrees\n", workspace.scale, workspace.force_gain,
                workspace.yaw_deg);
  if (workspace.home)
    std::printf("home       %g, %g, %g mm from the volume's centre\n", workspace.home->x(),
                workspace.home->y(), workspace.home->z());
  if (workspace.clutch_button >= 0) std::printf("clutch     button %d\n", workspace.clutch_button);
}

/// Warns of a Gaussian narrower than a voxel, which does not smooth the steps between voxels. A ramp on the
/// scan has no such steps and may do without smoothing.
void warn_of_narrow_sigma(const Scene& scene, const Data& data, Console& console) {
  if (scene.preparation.method != PreparationMethod::kUnionGaussian &&
      scene.force.method != ForceMethod::kSmoothSphere)
    return;
  const double sigma_mm = scene.preparation.sigma_mm;
  const double widest_mm = largest_spacing_mm(data.labels_grid(), data.scan_grid());
  constexpr double kRounding = 1e-3;
  const bool touchable_labels =
      std::any_of(scene.tissues.begin(), scene.tissues.end(),
                  [](const auto& tissue) { return tissue.touchable && !tissue.threshold; });
  if (sigma_mm >= widest_mm * (1 - kRounding) || (sigma_mm == 0 && !touchable_labels)) return;
  char text[160];
  std::snprintf(text, sizeof text,
                "sigma = %.3g mm is less than the voxel size of up to %.3g mm: the steps between voxels will "
                "be felt; %.3g mm or more smooths them",
                sigma_mm, widest_mm, widest_mm);
  console.warn()(text);
}

/// Prints the structures that belong to no tissue, and optional labels that the map does not have.
void print_left_over(const Scene& scene, const LabelMap& labels,
                     const std::vector<std::vector<LabelId>>& ids) {
  std::set<LabelId> used_labels;
  for (const auto& tissue : ids) used_labels.insert(tissue.begin(), tissue.end());
  std::vector<std::string> free;
  for (const Segment& segment : labels.segments) {
    if (!used_labels.contains(segment.id)) free.push_back(display_name(segment));
  }
  if (!free.empty())
    std::printf("\nnot touchable, because they belong to no tissue: %s\n", join(free).c_str());

  std::vector<std::string> empty;
  for (std::size_t i = 0; i < scene.tissues.size(); ++i) {
    if (!scene.tissues[i].threshold && !scene.tissues[i].embedding && ids[i].empty())
      empty.push_back(scene.tissues[i].name);
  }
  if (!empty.empty()) std::printf("\noptional and absent: %s\n", join(empty).c_str());
}

int run_check(const std::string& file, Console& console) {
  if (is_volume(file))
    return console.fail({ErrorKind::kBadInput, "is a volume, not a scene", file,
                         "palpate scene new " + file + " -o scene.toml writes a scene for it"});
  if (auto other = describe_non_volume(file)) return console.fail(*other);
  const auto scene = load_scene(file);
  if (!scene) return console.fail(scene.error());

  // input files of the scene
  const auto resolved = [&](const std::optional<fs::path>& named) {
    return named ? std::optional(scene->resolve(*named)) : std::nullopt;
  };
  const auto data = read_data(resolved(scene->scan), scene->scan_volume, resolved(scene->labels),
                              resolved(scene->names), placement_options_of(*scene), console);
  if (!data) return console.fail(data.error());
  std::vector<std::vector<LabelId>> ids(scene->tissues.size());
  if (data->labels) {
    auto found = resolve_labels(*scene, data->labels->labels);
    if (!found) return console.fail(found.error());
    ids = std::move(*found);
    if (const auto protected_labels = resolve_no_go(*scene, data->labels->labels); !protected_labels)
      return console.fail(protected_labels.error());
  }
  if (const auto grids =
          compare_grids(*data, resolved(scene->labels).value_or(""),
                        scene->scan_is_cropped || placement_options().scan_is_cropped, console);
      !grids) {
    Error error = grids.error();
    error.where = scene->where(scene->lines.labels);
    return console.fail(error);
  }
  warn_of_narrow_sigma(*scene, *data, console);
  const GridGeometry grid = field_grid(data->labels_grid(), data->scan_grid());
  const auto width_mm = ramp_width_mm(scene->preparation.ramp_width_mm, grid);
  if (!width_mm) {
    Error error = width_mm.error();
    error.where = file;
    return console.fail(error);
  }

  // contents of the scene
  std::printf("%s: a valid scene\n", file.c_str());
  if (!scene->title.empty()) std::printf("title      %s\n", scene->title.c_str());
  std::printf("side       %s\n", side_text(*scene, *data).c_str());
  print_preparation(scene->preparation, *width_mm);
  std::printf("force      %s\n", std::string(name_of(scene->force.method)).c_str());
  print_deformation(scene->deformation);
  print_relaxations(*scene);
  print_tool("tool", scene->tools[0]);
  if (scene->tools.size() > 1) print_tool("2nd tool", scene->tools[1]);
  print_workspace(scene->workspace);
  if (scene->max_force_N) std::printf("limit      %g N\n", *scene->max_force_N);
  for (const NoGoSettings& region : scene->no_go)
    std::printf("no-go      %s, keep away %g mm, %g N/mm\n", region.name.c_str(), region.keep_away_mm,
                region.stiffness_N_per_mm);
  print_tissues(*scene, ids, grid);
  if (data->labels) print_left_over(*scene, data->labels->labels, ids);
  if (std::none_of(scene->tissues.begin(), scene->tissues.end(),
                   [](const auto& tissue) { return tissue.touchable; }))
    console.warn()("this scene has no touchable tissue: set touchable = true on a tissue");
  else
    warn_if_nothing_deforms(*scene, console);
  warn_of_ignored_stiffness(*scene, console);
  return kExitOk;
}

void add_check(CLI::App& app, Run& run) {
  const auto file = std::make_shared<std::string>();
  CLI::App* verb =
      app.add_subcommand("check", "Check a scene and the files that it names, and show its contents");
  verb->add_option("scene", *file, "The scene file")->required();
  verb->footer("Examples:\n  palpate scene check scene.toml");
  verb->callback([file, &run] { run = [file](Console& console) { return run_check(*file, console); }; });
}

// ---- scene keys, scene presets ------------------------------------------------------------------

void add_scene_keys(CLI::App& app, Run& run) {
  const auto script = std::make_shared<bool>(false);
  CLI::App* verb = app.add_subcommand("keys", "Print every key of a scene file as Markdown tables");
  verb->add_flag("--script", *script, "Print the keys of a palpation script instead");
  verb->footer("Examples:\n  palpate scene keys\n  palpate scene keys --script");
  verb->callback([script, &run] {
    run = [script](Console&) { return print_result(*script ? script_keys() : scene_keys()); };
  });
}

void add_scene_presets(CLI::App& app, Run& run) {
  CLI::App* verb =
      app.add_subcommand("presets", "Print every tissue preset with its values and their sources");
  verb->footer("Example: palpate scene presets");
  verb->callback([&run] {
    run = [](Console&) {
      return print_result("### Stiffness and friction\n\n" + tissue_preset_table() +
                          "\n### Elastic moduli\n\n" + elastic_preset_table() + "\n### Relaxation\n\n" +
                          relaxation_preset_table());
    };
  });
}

}  // namespace

void add_scene(CLI::App& app, Run& run) {
  CLI::App* verb = app.add_subcommand("scene", "Write or check a scene file, or list its keys and presets");
  verb->require_subcommand(1);
  verb->footer(
      "Examples:\n"
      "  palpate scene new scan.nii.gz labels.nii.gz -o scene.toml\n"
      "  palpate scene check scene.toml\n"
      "  palpate scene keys");
  add_new(*verb, run);
  add_check(*verb, run);
  add_scene_keys(*verb, run);
  add_scene_presets(*verb, run);
}

}  // namespace palpate::app
