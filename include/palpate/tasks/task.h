#pragma once

#include <memory>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/contact/model.h"
#include "palpate/rehearsal/plan_in_scene.h"
#include "palpate/rehearsal/removal_follower.h"
#include "palpate/scene/task_file.h"
#include "palpate/tasks/burr_meters.h"
#include "palpate/tasks/scope_visibility.h"

/// A task with its structures, regions and answer resolved in a scene.
namespace palpate {

/// Surface of structures divided into patches: the cubes of 1 mm, aligned with the patient's axes and origin,
/// that the surface intersects.
class SurfacePatches {
 public:
  static constexpr double kEdge_mm = 1;
  static constexpr double kWithin_mm = 0.5;

  /// Adds the cube that contains a point.
  void add(const Eigen::Vector3d& position_mm);
  std::size_t count() const { return covered_.size(); }
  std::size_t covered() const { return covered_count_; }
  /// Marks as covered every patch of which a part is within kWithin_mm of a contact.
  void cover(const Eigen::Vector3d& contact_mm);
  struct Patch {
    Eigen::Vector3d centre_mm;
    bool covered = false;
  };
  /// All patches in the order of insertion.
  std::vector<Patch> all() const;

 private:
  std::unordered_map<std::uint64_t, std::uint32_t> at_;  // by cube
  std::vector<bool> covered_;
  std::size_t covered_count_ = 0;
};

/// A TaskRegion resolved in a scene.
struct RegionInScene {
  std::vector<bool> has_label;  ///< Structures by LabelId; empty: the region is a ball
  std::optional<Eigen::Vector3d> centre_mm;
  double radius_mm = 0;
  struct Plane {
    Eigen::Vector3d point_mm, normal;
  };
  std::vector<Plane> planes;  ///< Intersection of the half-spaces on the side of each normal
  SurfacePatches patches;     ///< Patches, for regions of kCover steps

  bool has(LabelId label) const { return label < has_label.size() && has_label[label]; }
  /// Whether a point lies within the sphere, if the region has one, and on the positive side of all planes.
  /// Labels are not tested.
  bool contains_point(const Eigen::Vector3d& position_mm) const;
};

/// A task's plan resolved in a scene before any removal.
struct TaskPlan {
  PlanInScene plan;
  std::vector<double> planned_mm3;  ///< Removable volume of each region
  RemovalFollower untouched;
  Tool tool;  ///< Tool of the first device
  Transform<World, Patient> X_WorldPatient;
};

/// A task file with everything it names resolved in a scene.
struct TaskInScene {
  TaskFile file;
  std::vector<RegionInScene> regions;  ///< Regions, in the order of file.regions
  /// Structures of each force and protection, by LabelId, in the order of file.forces and file.protections
  std::vector<std::vector<bool>> forces, protections;
  /// Structures of each metric, by LabelId, in the order of file.metrics; empty: all structures
  std::vector<std::vector<bool>> metrics;
  std::optional<Eigen::Vector3d> answer_mm;  ///< Centroid of the structures to be found
  std::vector<bool> answer_labels;           ///< Structures to be found, by LabelId
  std::optional<ScopeVisibility> sight;
  /// Distances of the structures of each metric that needs them, in the order of file.metrics; else null
  std::vector<StructureDistances> distances;
  std::optional<MicroscopeView> microscope;
  std::optional<TaskPlan> plan;
};

/// Suggested view of a region, patient frame.
struct RegionView {
  Eigen::Vector3d centre_mm = Eigen::Vector3d::Zero();
  double radius_mm = 0;  ///< Radius of the bounding sphere around the centre
  /// Mean outward normal of the surface that is not covered by touchable tissue; unit. Zero: no preferred
  /// direction.
  Eigen::Vector3d outward = Eigen::Vector3d::Zero();
};
/// Suggested view of a region of the task.
RegionView view_of(const RegionInScene& region, const Model& model);
/// Suggested view of a region to be removed.
RegionView view_of(const RegionInPlan& region, const Model& model);

/// Resolves a task in a scene. Errors: kBadInput with the line of an absent structure or of an empty region;
/// with the task's name if tissue is to be removed and no tool cuts; kInterrupted.
/// @param model  a model with labels; the surfaces of the proxy are used if present, otherwise voxel faces
Result<TaskInScene> resolve_task(const TaskFile& task, const Model& model, const Progress& progress = {});

}  // namespace palpate
