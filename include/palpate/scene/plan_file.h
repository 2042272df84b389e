#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/base/embedded_file.h"
#include "palpate/scene/scene.h"

/// The plan file, TOML: what is to be done in a scene and rehearsed there: trajectories, what is to be taken
/// off, and from what to keep away. Read as scenes and tasks are: unknown keys, wrong types and values out of
/// range are errors with their line. docs/reference/plan-keys.md has every key. Structures are named and
/// looked up later, where a scene is at hand (palpate/rehearsal/plan_in_scene.h).
namespace palpate {

inline constexpr std::size_t kMaxPlanParts = 200;  ///< of trajectories, regions, distances each
inline constexpr double kMinTrajectory_mm = 0.1, kMaxTrajectory_mm = 1000;

/// A straight way into the patient, mm, LPS.
struct PlanTrajectory {
  std::string name;
  Point<Patient> entry, target;
  /// Whose surface it enters; empty: the entry is a place alone.
  std::vector<LabelReference> enters;
  /// What is allowed: distance from the entry and from the target, angle to the trajectory, 0 ... 90 degrees,
  /// and how much too deep or too shallow. Absent: it is told and does not count.
  std::optional<double> entry_within_mm, target_within_mm, angle_within_deg, depth_within_mm;
  int line = 0;

  double length_mm() const { return (target - entry).norm(); }  ///< kMinTrajectory_mm ... kMaxTrajectory_mm
  Vector<Patient> axis() const { return (target - entry).normalized(); }
};

enum class PlanShape {
  kStructures,  ///< all of some structures
  kSphere,
  kCylinder,  ///< with flat ends
  kBox,
};
/// Something to be taken off.
struct PlanRegion {
  std::string name;
  PlanShape shape = PlanShape::kStructures;
  std::size_t trajectory = 0;  ///< of a shape: place in PlanFile::trajectories
  /// Of a shape: it is of these alone, or of all that can be taken off.
  std::vector<LabelReference> structures;
  double radius_mm = 0;  ///< of a sphere, a cylinder
  /// Of a cylinder, a box: it goes from here to depth_mm, along the trajectory, 0 the entry.
  double from_mm = 0;
  double depth_mm = 0;  ///< likewise; of a sphere where its middle is
  /// Of a box across the trajectory: along `across`, and along what is perpendicular to both.
  double width_mm = 0, height_mm = 0;
  Vector<Patient> across;  ///< unit, perpendicular to the trajectory
  int line = 0;
};

struct PlanDistance {
  std::vector<LabelReference> structures;
  double distance_mm = 0;  ///< from each of them the tool is to keep away so far
  int line = 0;
};

struct PlanFile {
  /// The lines of comments at its beginning, as they stand there: who made it, for what.
  std::string heading;
  std::string title;
  std::vector<PlanTrajectory> trajectories;
  std::vector<PlanRegion> regions;
  std::vector<PlanDistance> distances;
  std::string source;
  std::uint64_t text_hash = 0;

  std::string where(int line) const { return source + ":" + std::to_string(line); }
};

/// @param source  names the text in errors ("plan.toml:12: ...")
Result<PlanFile> parse_plan(std::string_view text, const std::string& source);
/// A plan of embedded_plans() by its name, else the file. @param beside  where a relative path begins
Result<PlanFile> load_plan(const std::string& name_or_file, const std::filesystem::path& beside = {});

/// The files of data/plans/, compiled in.
const std::vector<EmbeddedFile>& embedded_plans();

/// The plan as a text that parse_plan reads as the same plan, every number to its last bit. Names are UTF-8.
std::string plan_text(const PlanFile& plan);

/// Every key of a plan file as Markdown tables: those of docs/reference/plan-keys.md.
std::string plan_keys();

}  // namespace palpate
