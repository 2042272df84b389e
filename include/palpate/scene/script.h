#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "palpate/base/force_method.h"
#include "palpate/base/result.h"
#include "palpate/contact/model.h"
#include "palpate/contact/scope.h"
#include "palpate/device/model_change.h"
#include "palpate/geometry/geometry.h"

/// The palpation script (TOML): its contents and parser. Unknown keys and values out of range are errors with
/// their line ("script.toml:12: ..."). `palpate scene keys --script` documents every key with default, unit
/// and range.
namespace palpate {

/// Maximum number of steps of a script.
inline constexpr std::size_t kMaxScriptSteps = 1000;

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
