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

#include "palpate/device/telemetry.h"
#include "palpate/device/workspace.h"
#include "palpate/haptics/haptics.h"
#include "palpate/haptics/scope.h"
#include "palpate/preparation/preparation.h"
#include "palpate/volume/volume.h"

/// The scene file and the palpation script, both TOML: what they may hold, and how they are read.
/// Unknown keys, absent labels and values out of range are errors with their line ("scene.toml:12: ...").
/// docs/reference/scene-keys.md and docs/reference/script-keys.md document every key with default, unit
/// and range.
namespace palpate {

inline constexpr std::size_t kMaxTissues = 64;
inline constexpr std::size_t kMaxScriptSteps = 1000;
inline constexpr std::size_t kMaxSceneBytes = std::size_t{4} << 20;  ///< of a scene or a script

/// By which machine a scan was made; viewers show a CT's values as Hounsfield units.
enum class Modality : std::uint8_t { kUnknown, kCt, kMr };
/// Of surfaces, whose files do not say what their axes are.
enum class SurfaceAxes : std::uint8_t { kLps, kRas };
enum class SurfaceUnit : std::uint8_t { kMm, kCm, kM };
enum class HeaderForm : std::uint8_t { kQform, kSform };

/// What is chosen by a word in scenes, on the command line and on the wire; the unknown comes last.
template <class T>
struct Word {
  T value;
  std::string_view name;
};
inline constexpr std::array kSides{Word<Side>{Side::kLeft, "left"}, Word<Side>{Side::kRight, "right"},
                                   Word<Side>{Side::kBoth, "both"}, Word<Side>{Side::kUnknown, "unknown"}};
inline constexpr std::array kModalities{Word<Modality>{Modality::kCt, "ct"},
                                        Word<Modality>{Modality::kMr, "mr"},
                                        Word<Modality>{Modality::kUnknown, "unknown"}};
inline constexpr std::array kSurfaceAxes{Word<SurfaceAxes>{SurfaceAxes::kLps, "lps"},
                                         Word<SurfaceAxes>{SurfaceAxes::kRas, "ras"}};
inline constexpr std::array kSurfaceUnits{Word<SurfaceUnit>{SurfaceUnit::kMm, "mm"},
                                          Word<SurfaceUnit>{SurfaceUnit::kCm, "cm"},
                                          Word<SurfaceUnit>{SurfaceUnit::kM, "m"}};
inline constexpr std::array kHeaderForms{Word<HeaderForm>{HeaderForm::kQform, "q"},
                                         Word<HeaderForm>{HeaderForm::kSform, "s"}};
/// The last is what a scene has that says nothing.
inline constexpr std::array kTissueLaws{
    Word<TissueLaw>{TissueLaw::kElastic, "elastic"}, Word<TissueLaw>{TissueLaw::kNeoHookean, "neo-hookean"},
    Word<TissueLaw>{TissueLaw::kChainMail, "chainmail"}, Word<TissueLaw>{TissueLaw::kLayers, "layers"}};
template <class T, std::size_t kCount>
constexpr T value_of(std::string_view name, const std::array<Word<T>, kCount>& words) {
  const auto found =
      std::find_if(words.begin(), words.end(), [&](const Word<T>& word) { return word.name == name; });
  return found == words.end() ? words.back().value : found->value;
}
template <class T, std::size_t kCount>
constexpr std::string_view name_of(T value, const std::array<Word<T>, kCount>& words) {
  return std::find_if(words.begin(), words.end(), [&](const Word<T>& word) { return word.value == value; })
      ->name;
}

/// A label by its number (1 ... 65535) or by its exact name.
using LabelReference = std::variant<int, std::string>;

struct TissueSettings {
  std::string name;
  std::vector<LabelReference> labels;              ///< empty when `threshold` is given
  std::vector<int> label_lines;                    ///< of each label, for errors
  bool optional = false;                           ///< labels that the map does not have only drop out
  std::optional<std::array<double, 2>> threshold;  ///< ramp on the raw scan: 0 at [0], full at [1]
  std::string preset;                              ///< the preset the other values started from, or empty
  bool felt = true;
  double stiffness_N_per_mm = 1.0;
  double friction_coefficient = 0.1;
  std::optional<double> static_friction;  ///< empty: friction_coefficient
  std::optional<double> puncture_N;       ///< empty: never
  bool stays_open = false;                ///< Tissue::stays_open
  double cutting_energy_mJ_per_mm3 = Tissue().cutting_energy_mJ_per_mm3;
  Protection protection = Protection::kNone;  ///< of a burr; only of what is felt
  std::optional<ElasticConstants> elastic;    ///< Tissue::elastic
  Relaxation relaxation;                      ///< Tissue::relaxation; of a preset by itself what it may have
  double friction_damping_N_s_per_mm = 0.005;
  double friction_max_N = 0.5;
  double viscosity_N_s_per_mm = 0.001;
  std::optional<Rgb> colour;  ///< empty: the label's own colours are kept
  double opacity = 1.0;
  std::vector<std::string> rests_on;  ///< names of tissues in this scene
  int line = 0;                       ///< of its [[tissue]] header, for errors
};

enum class FieldStorage : std::uint8_t { k8Bit, k16Bit };

/// How labels become the field that the direct methods read.
enum class PreparationMethod : std::uint8_t {
  kInwardRamp,     ///< 0 outside, rising inside with the depth (palpate/surfaces/ramps.h)
  kUnionGaussian,  ///< all structures together, smoothed: as published
};

struct PreparationSettings {
  PreparationMethod method = PreparationMethod::kInwardRamp;
  std::optional<double> ramp_width_mm;  ///< of the inward ramp; empty: what ramp_width_mm() takes
  double sigma_mm = 1.0;                ///< of the union Gaussian and of the smooth sphere
  GaussianEngine engine = GaussianEngine::kDirect;
  FieldStorage storage = FieldStorage::k16Bit;
};

/// By which method the structures are felt at first.
struct ForceSettings {
  ForceMethod method = ForceMethod::kProxy;
  MethodSettings settings;
};

/// Whether soft tissue gives way.
struct YieldingSettings {
  TissueLaw law = TissueLaw::kLayers;
  std::optional<double> cell_mm;  ///< of the elastic laws; empty: chosen from the voxels
  bool relaxation = false;        ///< likewise: tissues have that of their presets
};

/// Of which structures distances are told.
enum class ToldStructures : std::uint8_t { kNone, kFelt, kAll };
struct DistanceSettings {
  ToldStructures structures = ToldStructures::kNone;
  double reach_mm = 20;
};

/// A [[no_go]]: of structures, or a plane, or a ball.
struct NoGoSettings {
  std::string name;
  std::vector<LabelReference> structures;  ///< empty: `place` is given
  std::vector<int> structure_lines;        ///< of each, for errors
  std::variant<std::monostate, NoGoPlane, NoGoSphere> place;
  double keep_away_mm = 1;
  double stiffness_N_per_mm = 2;
  int line = 0;  ///< of its header, for errors
};

struct Scene {
  std::string title;
  Side side = Side::kUnknown;
  Modality modality = Modality::kUnknown;
  std::optional<std::filesystem::path> scan;  ///< as written; relative to `folder`
  std::optional<int> scan_volume;             ///< which one, where `scan` holds several
  std::optional<std::filesystem::path> labels;
  std::optional<SurfaceAxes> mesh_space;  ///< how `labels` are to be read where they are surfaces
  std::optional<SurfaceUnit> mesh_unit;
  std::optional<Eigen::Vector3d> image_spacing_mm;  ///< of stacks of pictures: columns, rows, slices
  std::optional<HeaderForm> nifti_form;             ///< which placement of a NIfTI counts that has two
  bool scan_is_cropped = false;                     ///< more than half of the labels may lie outside the scan
  std::optional<std::filesystem::path> names;       ///< colour table
  std::vector<TissueSettings> tissues;
  PreparationSettings preparation;
  ForceSettings force;
  YieldingSettings yielding;
  std::vector<Tool> tools{Tool()};  ///< Model::tools: [tool], then [second_tool] where the scene has it
  WorkspaceSettings workspace;      ///< of every device; no part of the model
  std::optional<double> max_force_N;
  DistanceSettings distances;
  std::vector<NoGoSettings> no_go;  ///< regions of all together at most kMaxNoGo
  std::filesystem::path folder;     ///< where the scene file stands
  std::string source;               ///< its name, for errors
  struct DataLines {
    int scan = 0, labels = 0, names = 0;
  } lines;  ///< where the data are named, for errors

  /// `file` as a path that opens from the current folder: absolute ones as they are, others below `folder`.
  std::filesystem::path resolve(const std::filesystem::path& file) const;
  /// "scene.toml:12", for errors.
  std::string where(int line) const;
};

/// A text without a [data] table is accepted, with neither scan nor labels: its volumes come from the
/// caller, as for the embedded scenes.
/// @param text    TOML, at most kMaxSceneBytes
/// @param source  names the text in errors ("scene.toml:12: ...")
Result<Scene> parse_scene(std::string_view text, const std::string& source);
/// Reads a scene file, which has to name its data. A data file that does not exist is an error with its line.
Result<Scene> load_scene(const std::filesystem::path& file);

/// The scene that suits a catalogue data set ("knee-phantom", "knee-atlas", "head"), or the one of that
/// name ("knee", "head"); it has no [data] table. The file in data/scenes/, compiled in.
std::optional<std::string_view> embedded_scene(std::string_view name);

/// The grid that a scene's field is made on: the finer of the two by the volume of a voxel, the labels'
/// where they are equal. Either may be null, not both.
const GridGeometry& field_grid(const GridGeometry* labels, const GridGeometry* scan);
/// The widest voxel of the grids behind the field, mm: labels stand in steps of their own grid, the field is
/// interpolated on field_grid(). A sigma below it leaves these steps to be felt (docs/results/accuracy.md).
double widest_voxel_mm(const GridGeometry* labels, const GridGeometry* scan);
/// The force deep inside a tissue under a union Gaussian, N: stiffness * sigma * sqrt(2 pi), the height of a
/// ramp that a Gaussian leaves of a step and that is as steep as the stiffness at the surface. Without
/// smoothing the ramp is a voxel wide.
/// @param grid  the field's
double most_force_N(const TissueSettings& tissue, double sigma_mm, const GridGeometry& grid);

/// Mechanical starting values for a kind of tissue, and where they come from.
struct TissuePreset {
  std::string name;  ///< bone, cartilage, muscle, liver, ...: the choices of the key `preset`
  TissueSettings values;
  std::string source;                        ///< publication, value there, and how ours follows from it
  std::vector<std::string> kind_words;       ///< lower-case words that say what a structure is made of
  std::vector<std::string> structure_names;  ///< lower-case names of structures made of it
};
const std::vector<TissuePreset>& tissue_presets();
/// The preset of that name, or nullptr.
const TissuePreset* find_preset(std::string_view name);
/// The tissue that a structure's name suggests.
struct PresetMatch {
  const TissuePreset* preset = nullptr;  ///< null: none
  std::string term;        ///< the term that decided, "sterno thyroid"; empty: the name holds no known term
  bool is_hollow = false;  ///< the term is one of air or fluid, or of a space that holds it: no resistance
};
/// Looks a structure's name up by whole terms of one or more words. Words are compared in any case, with
/// plural s, number or between other marks ("Left-Cerebral-White-Matter"); a word counts in the longest term
/// that holds it alone ("sterno_thyroid" is a muscle). Contents (cyst, air, implant) outrank kinds of tissue
/// ("patellar_cartilage" is cartilage), these the names of structures; then the last term in the name wins,
/// then the longest.
PresetMatch match_preset(const std::string& structure_name);

/// From where to where a number among a tissue's keys may lie.
std::array<double, 2> tissue_key_range(std::string_view key);
/// The same of a limit of the force, N: a scene's and a user's.
std::array<double, 2> max_force_range_N();

/// Which ids each tissue of the scene takes from the label map, ascending; none for tissues by threshold.
/// A name takes every segment so named. Error with the line of the label where it is absent, unless the
/// tissue is optional, and where it is claimed twice.
Result<std::vector<std::vector<LabelId>>> resolve_labels(const Scene& scene, const LabelMap& labels);

/// The same of each [[no_go]] of structures, of the others none; a structure may be in several. Error with
/// the line of the label where it is absent.
Result<std::vector<std::vector<LabelId>>> resolve_no_go(const Scene& scene, const LabelMap& labels);

/// What a new scene is written for: a label map with `labels` naming its file, or a scan alone.
struct NewSceneInput {
  std::optional<std::filesystem::path> scan = {}, labels = {}, names = {};
  std::string names_from = {};  ///< where the labels have their names from, a comment of the scene
  const LabelMap* label_map = nullptr;
  const Volume<float>* scan_volume = nullptr;  ///< beside labels only its grid counts
  std::string title = {};
  Side side = Side::kUnknown;
  Modality modality = Modality::kUnknown;
  /// None: elastic where a structure gets a preset with a modulus, else by layers.
  std::optional<TissueLaw> law = {};
  std::optional<int> volume_of_scan = {};      ///< its number, where `scan` holds several
  std::optional<SurfaceAxes> mesh_space = {};  ///< as it was said of `labels`
  std::optional<SurfaceUnit> mesh_unit = {};
  std::optional<Eigen::Vector3d> image_spacing_mm = {};
  std::optional<HeaderForm> nifti_form = {};
  bool scan_is_cropped = false;
};
/// The text of a scene file for these files, every structure in the tissue its name suggests; structures
/// that suggest none get a tissue each that is shown and not felt (one together when they are too many).
/// Paths are written relative to `folder` where they lie below it, else absolute. Without labels (a raw
/// scan) the scene has one tissue by threshold, from the scan's values by Otsu's method (1979). Sigma is at
/// least 1 mm and at least the widest voxel.
/// Errors: neither labels nor scan, no structure, a scan of one value, a path that is not UTF-8.
Result<std::string> new_scene_text(const NewSceneInput& input, const std::filesystem::path& folder);
/// Writes the text whole or not at all. Errors are kOutput.
Result<void> write_scene_text(const std::filesystem::path& file, std::string_view text);

/// Every key of a scene file as Markdown tables (key, value, default, unit, range, meaning): the tables of
/// docs/reference/scene-keys.md, from the declarations that the parser itself checks against.
std::string scene_keys();
/// The presets with their values and sources as a Markdown table.
std::string tissue_preset_table();
/// What each preset is made of under the elastic law, with range and source, as a Markdown table.
std::string elastic_preset_table();
/// How presets relax under that law, with range and source, as a Markdown table.
std::string relaxation_preset_table();

// ---- script -------------------------------------------------------------------------------------

/// The patient's directions, LPS, by the names that scripts give them.
inline constexpr std::array<std::pair<std::string_view, std::array<double, 3>>, 6> kPatientDirections{
    {{"superior", {0, 0, 1}},
     {"inferior", {0, 0, -1}},
     {"anterior", {0, -1, 0}},
     {"posterior", {0, 1, 0}},
     {"left", {1, 0, 0}},
     {"right", {-1, 0, 0}}}};

/// Move to a free point in front of a structure, then touch it.
struct ApproachStep {
  std::string structure;                ///< name, or "#95" for a label number; empty: `point` is given
  std::optional<Point<Patient>> point;  ///< the nearest felt structure there is touched
  /// Of the structure: the place that is farthest this way, or nearest to another structure (name or
  /// "#95") or point. At most one of the two; without any the hand chooses.
  std::optional<Vector<Patient>> landmark;  ///< one of kPatientDirections
  std::variant<std::monostate, std::string, Point<Patient>> nearest;
  std::optional<Vector<Patient>> from;  ///< unit, from the surface to where the hand comes from
  double speed_mm_s = 40;
  double clearance_mm = 15;  ///< start at most this far in front of the surface, along its normal
};
/// Push along the surface normal until the force is reached.
struct PressStep {
  double force_N = 1.0;
  double settle_s = 0.5;
};
/// Keep the force for a time.
struct HoldStep {
  double seconds = 0.6;
};
/// Move along the surface, keeping the force.
struct SlideStep {
  Vector<Patient> direction{0, 0, 1};  ///< made tangential; need not be unit
  double distance_mm = 5;
  double speed_mm_s = 10;
};
/// Turn the object by this much, commanded 10 times a second, while the hand stays.
struct RotateStep {
  Eigen::Vector3d axis_world{0, 0, 1};
  double degrees = 10;
  double seconds = 1;
};
/// Feel by another method from here on; the force of the last one turns into the new one's.
struct MethodStep {
  ForceMethod method = ForceMethod::kProxy;
};
/// Soft tissue by another law from here on.
struct LawStep {
  TissueLaw law = TissueLaw::kLayers;
};
/// Switch the tool's motor on or off.
struct MotorStep {
  bool on = true;
};
/// Undo the last stroke of a tool that cuts, or do it again.
struct StrokeStep {
  StrokeAction action = StrokeAction::kUndo;
};
/// The scope in the second device looks at something from here on.
struct ScopeStep {
  std::optional<Point<Patient>> at;  ///< empty: the first device's tip, with which it goes
  Vector<Patient> from{0, -1, 0};    ///< unit, from there to the camera
  double distance_mm = 20;           ///< likewise
  double speed_mm_s = 40;
  ScopeOptics optics;
};
/// Withdraw along the path of approach.
struct LeaveStep {
  double speed_mm_s = 60;
};
using ScriptStep = std::variant<ApproachStep, PressStep, HoldStep, SlideStep, RotateStep, MethodStep,
                                LeaveStep, MotorStep, StrokeStep, LawStep, ScopeStep>;
/// Press, hold, slide and leave need the contact that an approach before them makes.
bool needs_contact(const ScriptStep& step);

struct Script {
  std::string title;
  std::string device = "premium-1.5";  ///< known_plant_devices()
  std::string hand = "firm-grip";      ///< known_plant_hands()
  double rate_hz = 1000;               ///< 250 ... 10000
  double delay_s = 0;                  ///< from a command to its force, 0 ... 0.02
  double tremor_mm = 0.03;             ///< amplitude of physiological tremor (8-12 Hz), 0 ... 1
  std::uint64_t seed = 1;
  std::vector<ScriptStep> steps;
  std::vector<int> lines;              ///< of each step, for errors
  int device_line = 0, hand_line = 0;  ///< 0: the script does not name it
  std::string source;
};
/// Whether a second device holds a scope in it.
bool has_scope(const Script& script);
/// What needs contact comes after an approach, and an approach after the one before it was left: errors with
/// their line. Device and hand are looked up by the session.
Result<Script> parse_script(std::string_view text, const std::string& source);
Result<Script> load_script(const std::filesystem::path& file);

/// The script that suits an embedded scene ("knee", "knee-phantom", "knee-atlas"). The file in
/// data/scripts/, compiled in.
std::optional<std::string_view> embedded_script(std::string_view name);

/// Every key of a script as Markdown tables: the tables of docs/reference/script-keys.md.
std::string script_keys();

}  // namespace palpate
