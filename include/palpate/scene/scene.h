#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "palpate/contact/model.h"
#include "palpate/contact/scope.h"
#include "palpate/device/telemetry.h"
#include "palpate/device/workspace.h"
#include "palpate/preparation/preparation.h"
#include "palpate/volume/volume.h"

/// The scene file and the palpation script (both TOML): their contents and parsers. Unknown keys, absent
/// labels and values out of range are errors with their line ("scene.toml:12: ...").
/// `palpate scene keys` and `palpate scene keys --script` document every key with default, unit and
/// range.
namespace palpate {

/// Maximum number of tissues of a scene, and of steps of a script.
inline constexpr std::size_t kMaxTissues = 64;
inline constexpr std::size_t kMaxScriptSteps = 1000;
inline constexpr std::size_t kMaxSceneBytes = std::size_t{4} << 20;  ///< Maximum size of a scene or script

/// Imaging modality of a scan; viewers show the values of a CT in Hounsfield units.
enum class Modality : std::uint8_t { kUnknown, kCt, kMr };
/// Axis convention of surface meshes, for files that do not declare it.
enum class SurfaceAxes : std::uint8_t { kLps, kRas };
/// Length unit of surface meshes.
enum class SurfaceUnit : std::uint8_t { kMm, kCm, kM };
/// Transform of a NIfTI header: its quaternion (qform) or its affine matrix (sform).
enum class HeaderForm : std::uint8_t { kQform, kSform };

/// Enumerator with its name in scene files, on the command line and in the protocol. The last entry of each
/// table is the fallback for unknown names.
template <class T>
struct NamedValue {
  T value;
  std::string_view name;
};
inline constexpr std::array kSides{
    NamedValue<Side>{Side::kLeft, "left"}, NamedValue<Side>{Side::kRight, "right"},
    NamedValue<Side>{Side::kBoth, "both"}, NamedValue<Side>{Side::kUnknown, "unknown"}};
inline constexpr std::array kModalities{NamedValue<Modality>{Modality::kCt, "ct"},
                                        NamedValue<Modality>{Modality::kMr, "mr"},
                                        NamedValue<Modality>{Modality::kUnknown, "unknown"}};
inline constexpr std::array kSurfaceAxes{NamedValue<SurfaceAxes>{SurfaceAxes::kLps, "lps"},
                                         NamedValue<SurfaceAxes>{SurfaceAxes::kRas, "ras"}};
inline constexpr std::array kSurfaceUnits{NamedValue<SurfaceUnit>{SurfaceUnit::kMm, "mm"},
                                          NamedValue<SurfaceUnit>{SurfaceUnit::kCm, "cm"},
                                          NamedValue<SurfaceUnit>{SurfaceUnit::kM, "m"}};
inline constexpr std::array kHeaderForms{NamedValue<HeaderForm>{HeaderForm::kQform, "q"},
                                         NamedValue<HeaderForm>{HeaderForm::kSform, "s"}};
/// The last entry is the default of a scene that does not set the law.
inline constexpr std::array kTissueLaws{NamedValue<TissueLaw>{TissueLaw::kElastic, "elastic"},
                                        NamedValue<TissueLaw>{TissueLaw::kNeoHookean, "neo-hookean"},
                                        NamedValue<TissueLaw>{TissueLaw::kExponential, "exponential"},
                                        NamedValue<TissueLaw>{TissueLaw::kChainMail, "chainmail"},
                                        NamedValue<TissueLaw>{TissueLaw::kLayers, "layers"}};
template <class T, std::size_t kCount>
constexpr T value_of(std::string_view name, const std::array<NamedValue<T>, kCount>& names) {
  const auto found = std::find_if(names.begin(), names.end(),
                                  [&](const NamedValue<T>& named) { return named.name == name; });
  return found == names.end() ? names.back().value : found->value;
}
template <class T, std::size_t kCount>
constexpr std::string_view name_of(T value, const std::array<NamedValue<T>, kCount>& names) {
  return std::find_if(names.begin(), names.end(),
                      [&](const NamedValue<T>& named) { return named.value == value; })
      ->name;
}

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
double most_force_N(const TissueSettings& tissue, double sigma_mm, const GridGeometry& grid);

/// Default mechanical properties of a kind of tissue, with their source.
struct TissuePreset {
  std::string name;  ///< Name, a choice of the key `preset`: bone, cartilage, muscle, liver, ...
  TissueSettings values;
  std::array<double, 2> range_kPa{};  ///< Range of Young's modulus; 0 for a preset without elastic constants
  std::string source;                 ///< Publication, its value, and the derivation of ours
  std::vector<std::string> kind_words;       ///< Lower-case words that denote the material of a structure
  std::vector<std::string> structure_names;  ///< Lower-case names of structures made of it
};
/// All presets.
const std::vector<TissuePreset>& tissue_presets();
/// Preset by name, or nullptr.
const TissuePreset* find_preset(std::string_view name);
/// Preset suggested by a structure's name.
struct PresetMatch {
  const TissuePreset* preset = nullptr;  ///< Preset; null: none
  std::string term;        ///< Term of the name that decided, e.g. "sterno thyroid"; empty: no known term
  bool is_hollow = false;  ///< Whether the term denotes air, fluid or a cavity: no resistance
};
/// Matches a structure's name against whole terms of one or more words. Words are compared ignoring case,
/// plural s, numbers and separators ("Left-Cerebral-White-Matter"); a word counts only as part of the longest
/// matching term that contains it ("sterno_thyroid" is a muscle). Precedence: contents (cyst, air, implant),
/// then kinds of tissue ("patellar_cartilage" is cartilage), then names of structures; among equals the last
/// term in the name, then the longest.
PresetMatch match_preset(const std::string& structure_name);

/// Label ids of each tissue of the scene, ascending; empty for tissues by threshold. A name refers to every
/// segment of that name. Errors, with the line of the label: absent label, unless the tissue is optional;
/// label claimed twice.
Result<std::vector<std::vector<LabelId>>> resolve_labels(const Scene& scene, const LabelMap& labels);

/// Label ids of each [[no_go]], empty where it is not made of structures. Regions may share structures. Error
/// with the line of the label if it is absent.
Result<std::vector<std::vector<LabelId>>> resolve_no_go(const Scene& scene, const LabelMap& labels);

/// Input of new_scene_text: a label map with its file `labels`, or a scan alone.
struct NewSceneInput {
  std::optional<std::filesystem::path> scan = {}, labels = {}, names = {};
  std::string names_from = {};  ///< Origin of the label names, written as a comment
  const LabelMap* label_map = nullptr;
  const Volume<float>* scan_volume = nullptr;  ///< Scan; with labels only its grid is used
  std::string title = {};
  Side side = Side::kUnknown;
  Modality modality = Modality::kUnknown;
  /// Empty: elastic if any structure gets a preset with a modulus, otherwise by layers.
  std::optional<TissueLaw> law = {};
  std::optional<int> volume_of_scan = {};      ///< Number of the volume if `scan` holds several
  std::optional<SurfaceAxes> mesh_space = {};  ///< Axis convention given for `labels`
  std::optional<SurfaceUnit> mesh_unit = {};
  std::optional<Eigen::Vector3d> image_spacing_mm = {};
  std::optional<HeaderForm> nifti_form = {};
  bool scan_is_cropped = false;
  /// If no structure's name suggests a tissue: whether structures of unknown names are touchable, all with
  /// the stiffness of a raw scan's threshold, instead of shown only.
  bool touch_unknown = false;
  /// Whether to add a tissue of the unlabelled voxels inside the body, as soft as fat. If a scan determines
  /// where the body ends, its threshold by Otsu's method (1979) is written.
  bool embed = false;
};
/// Text of a scene file for these files. Every structure is assigned the tissue that its name suggests; each
/// structure without a suggestion gets its own tissue that is shown but exerts no force (one common tissue if
/// there are too many; see `touch_unknown`). Paths are relative to `folder` if below it, otherwise absolute.
/// Without labels (a raw scan) the scene has one tissue by threshold, derived from the scan's values by
/// Otsu's method (1979). Sigma is the largest voxel spacing, and at least 1 mm. Errors: neither labels nor
/// scan, no structure, a constant scan, a path that is not UTF-8.
Result<std::string> new_scene_text(const NewSceneInput& input, const std::filesystem::path& folder);
/// Writes the text atomically. Errors are kOutput.
Result<void> write_scene_text(const std::filesystem::path& file, std::string_view text);

/// Every key of a scene file as Markdown tables (key, value, default, unit, range, meaning);
/// generated from the declarations that the parser checks against.
std::string scene_keys();
/// The presets with their values and sources as a Markdown table.
std::string tissue_preset_table();
/// Elastic constants of each preset with range and source, as a Markdown table.
std::string elastic_preset_table();
/// Relaxation of each preset with range and source, as a Markdown table.
std::string relaxation_preset_table();

// ---- script -------------------------------------------------------------------------------------

/// Anatomical directions as unit vectors in LPS, by their names in scripts.
inline constexpr std::array<std::pair<std::string_view, std::array<double, 3>>, 6> kPatientDirections{
    {{"superior", {0, 0, 1}},
     {"inferior", {0, 0, -1}},
     {"anterior", {0, -1, 0}},
     {"posterior", {0, 1, 0}},
     {"left", {1, 0, 0}},
     {"right", {-1, 0, 0}}}};

/// Moves to a free point in front of a structure, then touches it.
struct ApproachStep {
  std::string structure;                ///< Name, or "#95" for a label number; empty: `point` is given
  std::optional<Point<Patient>> point;  ///< The nearest touchable structure there is approached
  /// Contact point on the structure: the extreme point in this direction, or the point nearest to another
  /// structure (name or "#95") or to a point. At most one of the two; without either, the simulated hand
  /// chooses.
  std::optional<Vector<Patient>> landmark;  ///< One of kPatientDirections
  std::variant<std::monostate, std::string, Point<Patient>> nearest;
  std::optional<Vector<Patient>> from;  ///< Unit direction from the surface to the start
  double speed_mm_s = 40;
  double clearance_mm = 15;  ///< Maximum starting distance from the surface, along its normal
};
/// Pushes along the surface normal until the force is reached.
struct PressStep {
  double force_N = 1.0;
  double settle_s = 0.5;
};
/// Holds the force for a time.
struct HoldStep {
  double seconds = 0.6;
};
/// Slides along the surface at constant force.
struct SlideStep {
  Vector<Patient> direction{0, 0, 1};  ///< Projected onto the tangent plane; need not be unit
  double distance_mm = 5;
  double speed_mm_s = 10;
};
/// Guides a running burr in a straight line to a point, cutting on the way.
struct MillStep {
  Point<Patient> to;      ///< Centre of the head at the end
  double force_N = 1;     ///< Greatest force with which the hand pulls
  double speed_mm_s = 8;  ///< Speed of the hand where nothing resists
};
/// Rotates the object by an angle, commanded at 10 Hz, while the hand stays.
struct RotateStep {
  Eigen::Vector3d axis_world{0, 0, 1};
  double degrees = 10;
  double seconds = 1;
};
/// Switches the force method; the force is blended from the old method to the new one.
struct MethodStep {
  ForceMethod method = ForceMethod::kProxy;
};
/// Switches the constitutive law of soft tissue.
struct LawStep {
  TissueLaw law = TissueLaw::kLayers;
};
/// Switches the tool's motor on or off.
struct MotorStep {
  bool on = true;
};
/// Undoes or redoes the last stroke of a cutting tool.
struct StrokeStep {
  StrokeAction action = StrokeAction::kUndo;
};
/// Points the scope in the second device at a target.
struct ScopeStep {
  std::optional<Point<Patient>> at;  ///< Target; empty: follows the first device's tip
  Vector<Patient> from{0, -1, 0};    ///< Unit direction from the target to the camera
  double distance_mm = 20;           ///< Distance from the target to the camera
  double speed_mm_s = 40;
  ScopeOptics optics;
};
/// Withdraws along the path of approach.
struct LeaveStep {
  double speed_mm_s = 60;
};
/// A step of a script: one of the actions above.
using ScriptStep = std::variant<ApproachStep, PressStep, HoldStep, SlideStep, RotateStep, MethodStep,
                                LeaveStep, MotorStep, StrokeStep, LawStep, ScopeStep, MillStep>;
/// Whether a step (press, hold, slide, mill, leave) requires the contact made by a preceding approach.
bool needs_contact(const ScriptStep& step);

/// A parsed script: the motion of a simulated hand, step by step.
struct Script {
  std::string title;
  std::string device = "premium-1.5";  ///< Name among known_plant_devices()
  std::string hand = "firm-grip";      ///< Name among known_plant_hands()
  double rate_hz = 1000;               ///< 250 ... 10000
  double delay_s = 0;                  ///< Latency from a command to its force, 0 ... 0.02
  double tremor_mm = 0.03;             ///< Amplitude of physiological tremor (8-12 Hz), 0 ... 1
  std::uint64_t seed = 1;
  std::vector<ScriptStep> steps;
  std::vector<int> lines;              ///< Line of each step, for errors
  int device_line = 0, hand_line = 0;  ///< 0: not set by the script
  std::string source;
  /// Limitations of a script planned for a scene: touchable structures that it leaves out or presses with
  /// less force, and the reason, one sentence each.
  std::vector<std::string> limitations = {};
};
/// Whether the script uses a second device that holds a scope.
bool has_scope(const Script& script);
/// Parses a script. Errors with their line include a step that needs contact without a preceding approach,
/// and an approach before the previous contact was left. Device and hand names are resolved later by the
/// session.
Result<Script> parse_script(std::string_view text, const std::string& source);
Result<Script> load_script(const std::filesystem::path& file);

/// Script of an embedded scene ("knee", "knee-phantom", "knee-atlas"): the file of data/scripts/, compiled
/// in.
std::optional<std::string_view> embedded_script(std::string_view name);

/// Every key of a script as Markdown tables, like scene_keys().
std::string script_keys();

}  // namespace palpate
