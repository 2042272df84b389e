#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "palpate/contact/model.h"
#include "palpate/device/workspace.h"
#include "palpate/preparation/preparation.h"
#include "palpate/volume/label_map.h"
#include "palpate/volume/volume.h"

/// The scene file (TOML): its contents and parser. Unknown keys, absent labels and values out of range are
/// errors with their line ("scene.toml:12: ..."). `palpate scene keys` documents every key with default, unit
/// and range.
namespace palpate {

/// Maximum number of tissues of a scene.
inline constexpr std::size_t kMaxTissues = 64;
inline constexpr std::size_t kMaxSceneBytes = std::size_t{4} << 20;  ///< Maximum size of a scene or script

/// Imaging modality of a scan; viewers show the values of a CT in Hounsfield units.
enum class Modality : std::uint8_t { kUnknown, kCt, kMr };
/// Axis convention of surface meshes, for files that do not declare it.
enum class SurfaceAxes : std::uint8_t { kLps, kRas };
/// Length unit of surface meshes.
enum class SurfaceUnit : std::uint8_t { kMm, kCm, kM };
/// Transform of a NIfTI header: its quaternion (qform) or its affine matrix (sform).
enum class HeaderForm : std::uint8_t { kQform, kSform };

/// Reference to a label by its number (1 ... 65535) or its exact name.
using LabelReference = std::variant<int, std::string>;

/// A [[tissue]] of the scene.
struct TissueSettings : TissueProperties {
  std::string name;
  std::vector<LabelReference> labels;  ///< Labels of the tissue; empty with `threshold` or `embedding`
  std::vector<int> label_lines;        ///< Line of each label, for errors
  /// Whether labels that are absent from the map are ignored; otherwise they are an error.
  bool optional = false;
  std::optional<std::array<double, 2>> threshold;  ///< Ramp on the raw scan values: 0 at [0], 1 at [1]
  bool embedding = false;           ///< Whether it consists of the unlabelled voxels inside the body
  std::optional<double> air_below;  ///< Scan value below which a voxel of an embedding is air
  /// Preset from which the defaults of this tissue were taken; empty: none.
  std::string preset;
  std::optional<Rgb> colour;          ///< Display colour; empty: that of each label
  std::vector<std::string> rests_on;  ///< Names of the tissues of this scene that support it
  int line = 0;                       ///< Line of its [[tissue]] header, for errors
};

/// Storage of a field value: 1 or 2 bytes.
enum class FieldStorage : std::uint8_t { k8Bit, k16Bit };

/// Conversion of labels to the field that the direct methods sample.
enum class PreparationMethod : std::uint8_t {
  kInwardRamp,     ///< 0 outside, increasing with depth inside (palpate/surfaces/ramps.h)
  kUnionGaussian,  ///< Gaussian smoothing of the union of all structures, as published
};

/// Preparation of the field for the direct methods.
struct PreparationSettings {
  PreparationMethod method = PreparationMethod::kInwardRamp;
  std::optional<double> ramp_width_mm;  ///< Width of the inward ramp; empty: default of ramp_width_mm()
  double sigma_mm = 1.0;                ///< Standard deviation of the union Gaussian and of the smooth sphere
  GaussianEngine engine = GaussianEngine::kDirect;
  FieldStorage storage = FieldStorage::k16Bit;
};

/// Initial force method and its settings.
struct ForceSettings {
  ForceMethod method = ForceMethod::kProxy;
  MethodSettings settings;
};

/// Settings of deformable tissue.
struct DeformationSettings {
  TissueLaw law = TissueLaw::kLayers;
  std::optional<double> cell_mm;  ///< Cell size of the elastic laws' grid; empty: chosen from the voxel size
  bool relaxation = false;        ///< Whether presets' relaxation applies where a tissue sets none
};

/// Structures whose distances to the tool are published.
enum class ReportedStructures : std::uint8_t { kNone, kTouchable, kAll };
/// Published distances between the tool and structures.
struct DistanceSettings {
  ReportedStructures structures = ReportedStructures::kNone;
  /// Maximum distance that is reported.
  double reach_mm = 20;
};

/// A [[no_go]] region: structures, a half-space bounded by a plane, or a sphere.
struct NoGoSettings {
  std::string name;
  std::vector<LabelReference> structures;  ///< Structures of the region; empty if `shape` is given
  std::vector<int> structure_lines;        ///< Line of each structure, for errors
  std::variant<std::monostate, NoGoPlane, NoGoSphere> shape;
  /// Clearance from the region at which the repelling spring begins.
  double keep_away_mm = 1;
  double stiffness_N_per_mm = 2;
  int line = 0;  ///< Line of its header, for errors
};

/// A parsed scene file.
struct Scene {
  std::string title;
  Side side = Side::kUnknown;
  Modality modality = Modality::kUnknown;
  std::optional<std::filesystem::path> scan;  ///< Path as written; relative to `folder`
  std::optional<int> scan_volume;             ///< Number of the volume if `scan` holds several
  std::optional<std::filesystem::path> labels;
  std::optional<SurfaceAxes> mesh_space;  ///< Axis convention of `labels` given as surface meshes
  std::optional<SurfaceUnit> mesh_unit;
  std::optional<Eigen::Vector3d> image_spacing_mm;  ///< Voxel spacing of image stacks: columns, rows, slices
  std::optional<HeaderForm> nifti_form;             ///< Transform to apply if a NIfTI header has both
  /// Whether the scan covers only part of the labelled region, so that more than half of the labels may be
  /// outside it.
  bool scan_is_cropped = false;
  std::optional<std::filesystem::path> names;  ///< Colour table with the label names
  std::vector<TissueSettings> tissues;
  PreparationSettings preparation;
  ForceSettings force;
  DeformationSettings deformation;
  std::vector<Tool> tools{Tool()};  ///< Tools as in Model::tools: [tool], then [second_tool] if present
  WorkspaceSettings workspace;      ///< Workspace mapping of every device; not part of the model
  std::optional<double> max_force_N;
  /// Attenuation at which bone has its tissue's cutting energy; empty: the scan is not stated to be a
  /// calibrated CT, and energies do not follow it
  std::optional<double> full_density_HU;
  DistanceSettings distances;
  std::vector<NoGoSettings> no_go;  ///< No-go regions, at most kMaxNoGo
  std::filesystem::path folder;     ///< Folder of the scene file
  std::string source;               ///< Name of the scene in errors
  struct DataLines {
    int scan = 0, labels = 0, names = 0;
  } lines;  ///< Lines of the data files, for errors

  /// Resolves a path of the scene: an absolute path is unchanged, a relative one is below `folder`.
  std::filesystem::path resolve(const std::filesystem::path& file) const;
  /// Source location such as "scene.toml:12", for errors.
  std::string where(int line) const;
};

/// Parses a scene. A text without a [data] table is accepted; it has neither scan nor labels, and the caller
/// supplies the volumes, as for the embedded scenes.
/// @param text    TOML, at most kMaxSceneBytes
/// @param source  name of the text in errors ("scene.toml:12: ...")
Result<Scene> parse_scene(std::string_view text, const std::string& source);
/// Reads a scene file; its [data] table is required. A missing data file is an error with its line.
Result<Scene> load_scene(const std::filesystem::path& file);

/// Embedded scene (file of data/scenes/, compiled in) of a catalogue data set ("knee-phantom", "knee-atlas",
/// "head") or by its own name ("knee", "head"). It has no [data] table.
std::optional<std::string_view> embedded_scene(std::string_view name);

/// Grid on which a scene's field is computed: the one with the smaller voxel volume, the labels' grid if
/// equal. At most one argument may be null.
const GridGeometry& field_grid(const GridGeometry* labels, const GridGeometry* scan);
/// Largest voxel spacing of the grids behind the field, mm. Label boundaries are stair-stepped on their own
/// grid, and the field is interpolated on field_grid(); a sigma below this spacing leaves the steps
/// perceptible (docs/results/accuracy.md).
double largest_spacing_mm(const GridGeometry* labels, const GridGeometry* scan);
/// Maximum force deep inside a tissue under a union Gaussian, N: stiffness * sigma * sqrt(2 pi), the height
/// of a Gaussian-smoothed step whose slope at the surface equals the stiffness. Without smoothing the ramp is
/// one voxel wide.
/// @param grid  grid of the field
double max_tissue_force_N(const TissueSettings& tissue, double sigma_mm, const GridGeometry& grid);

/// Label ids of each tissue of the scene, ascending; empty for tissues by threshold. A name refers to every
/// segment of that name. Errors, with the line of the label: absent label, unless the tissue is optional;
/// label claimed twice.
Result<std::vector<std::vector<LabelId>>> resolve_labels(const Scene& scene, const LabelMap& labels);

/// Label ids of each [[no_go]], empty where it is not made of structures. Regions may share structures. Error
/// with the line of the label if it is absent.
Result<std::vector<std::vector<LabelId>>> resolve_no_go(const Scene& scene, const LabelMap& labels);

/// Every key of a scene file as Markdown tables (key, value, default, unit, range, meaning);
/// generated from the declarations that the parser checks against.
std::string scene_keys();

}  // namespace palpate
