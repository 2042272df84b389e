#include <algorithm>
#include <cstdio>
#include <set>
#include <utility>

#include "apps/command/text.h"
#include "input_files.h"
#include "palpate/base/output.h"
#include "palpate/base/printable.h"
#include "palpate/device/rendered_stiffness.h"
#include "palpate/loading/loading.h"
#include "palpate/scene/named_values.h"
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
    return max_tissue_force_N(tissue, scene.preparation.sigma_mm, grid);
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
std::string side_text(const Scene& scene, const SceneData& data) {
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
void warn_of_narrow_sigma(const Scene& scene, const SceneData& data, Console& console) {
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

}  // namespace

void add_scene_check(CLI::App& app, Run& run) {
  const auto file = std::make_shared<std::string>();
  CLI::App* verb =
      app.add_subcommand("check", "Check a scene and the files that it names, and show its contents");
  verb->add_option("scene", *file, "The scene file")->required();
  verb->footer("Examples:\n  palpate scene check scene.toml");
  verb->callback([file, &run] { run = [file](Console& console) { return run_check(*file, console); }; });
}

}  // namespace palpate::app
