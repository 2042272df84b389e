#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/base/embedded_file.h"
#include "palpate/scene/scene.h"

/// The plan file (TOML): the goals of a rehearsal in a scene, i.e. trajectories, regions to remove and
/// structures to keep clear of. The same parsing rules as for scenes and tasks apply: unknown keys, wrong
/// types and values out of range are errors with their line. plan_keys() lists every key.
/// Structure names are resolved later against a scene (palpate/rehearsal/plan_in_scene.h).
namespace palpate {

/// Maximum number each of trajectories, regions and distances.
inline constexpr std::size_t kMaxPlanParts = 200;
inline constexpr double kMinTrajectory_mm = 0.1, kMaxTrajectory_mm = 1000;

/// A planned straight path into the patient. Points in patient millimetres (LPS).
struct PlanTrajectory {
  std::string name;
  Point<Patient> entry, target;
  /// Structures whose surface the trajectory enters. Empty: the entry is a free point.
  std::vector<LabelReference> enters;
  /// Tolerances: distance from the planned entry and target point, angle to the planned trajectory (0 ... 90
  /// degrees), and absolute depth error. Absent: the deviation is reported but not graded.
  std::optional<double> entry_within_mm, target_within_mm, angle_within_deg, depth_within_mm;
  int line = 0;

  double length_mm() const {
    return (target - entry).norm();
  }  ///< Length; kMinTrajectory_mm ... kMaxTrajectory_mm
  Vector<Patient> axis() const { return (target - entry).normalized(); }
};

enum class PlanShape {
  kStructures,  ///< All voxels of the given structures
  kSphere,
  kCylinder,  ///< Cylinder with flat ends
  kBox,
};
/// A region of tissue to remove.
struct PlanRegion {
  std::string name;
  PlanShape shape = PlanShape::kStructures;
  std::size_t trajectory = 0;  ///< Index into PlanFile::trajectories; for shapes other than kStructures
  /// For a geometric shape: the structures it is restricted to. Empty: all removable structures.
  std::vector<LabelReference> structures;
  double radius_mm = 0;  ///< Radius of a sphere or cylinder
  /// Start of a cylinder or box along the trajectory, measured from the entry point. Its end is depth_mm.
  double from_mm = 0;
  /// End of a cylinder or box along the trajectory; for a sphere the position of its centre. From the entry
  /// point.
  double depth_mm = 0;
  /// Size of a box perpendicular to the trajectory: width along `across`, height along the cross direction.
  double width_mm = 0, height_mm = 0;
  Vector<Patient> across;  ///< Width direction of a box; unit, perpendicular to the trajectory
  int line = 0;
};

/// Structures that the tool has to keep clear of.
struct PlanDistance {
  std::vector<LabelReference> structures;
  double distance_mm = 0;  ///< Minimum clearance between the tool and each structure
  int line = 0;
};

/// A parsed plan file.
struct PlanFile {
  /// Comment lines at the top of the file, verbatim, e.g. author and purpose.
  std::string heading;
  std::string title;
  std::vector<PlanTrajectory> trajectories;
  std::vector<PlanRegion> regions;
  std::vector<PlanDistance> distances;
  std::string source;
  std::uint64_t text_hash = 0;

  std::string where(int line) const { return source + ":" + std::to_string(line); }
};

/// @param source  name of the text in errors ("plan.toml:12: ...")
Result<PlanFile> parse_plan(std::string_view text, const std::string& source);
/// Loads an embedded plan by name (embedded_plans()), otherwise a file.
/// @param beside  base folder of a relative path
Result<PlanFile> load_plan(const std::string& name_or_file, const std::filesystem::path& beside = {});

/// The files of data/plans/, compiled in.
const std::vector<EmbeddedFile>& embedded_plans();

/// Serialises the plan. parse_plan of the text gives an identical plan, every number bit for bit. Names are
/// UTF-8.
std::string plan_text(const PlanFile& plan);

/// Every key of a plan file as Markdown tables (key, value, default, unit, range, meaning).
std::string plan_keys();

}  // namespace palpate
