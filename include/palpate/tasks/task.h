#pragma once

#include <memory>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/haptics/haptics.h"
#include "palpate/rehearsal/plan_in_scene.h"
#include "palpate/rehearsal/removal_follower.h"
#include "palpate/scene/task_file.h"
#include "palpate/tasks/seen.h"

/// A task whose structures, regions and answer were looked up in a scene.
namespace palpate {

/// The surface of structures in patches: the cubes of 1 mm, in rows along the patient's axes from its origin,
/// that the surface goes through.
class SurfacePatches {
 public:
  static constexpr double kEdge_mm = 1;
  static constexpr double kWithin_mm = 0.5;

  /// Adds the cube of a place.
  void add(const Eigen::Vector3d& place_mm);
  std::size_t count() const { return covered_.size(); }
  std::size_t covered() const { return covered_count_; }
  /// Those with a part within kWithin_mm of a contact count as covered from now on.
  void cover(const Eigen::Vector3d& contact_mm);
  struct Patch {
    Eigen::Vector3d middle_mm;
    bool covered = false;
  };
  /// In the order in which they were added.
  std::vector<Patch> all() const;

 private:
  std::unordered_map<std::uint64_t, std::uint32_t> at_;  // by cube
  std::vector<bool> covered_;
  std::size_t covered_count_ = 0;
};

/// A TaskRegion in a scene.
struct RegionInScene {
  std::vector<bool> has_label;  ///< by LabelId; empty: a ball
  std::optional<Eigen::Vector3d> centre_mm;
  double radius_mm = 0;
  struct Plane {
    Eigen::Vector3d point_mm, normal;
  };
  std::vector<Plane> planes;  ///< what lies on the side of each normal
  SurfacePatches patches;     ///< of regions that a step covers

  bool has(LabelId label) const { return label < has_label.size() && has_label[label]; }
  bool bounds(const Eigen::Vector3d& place_mm) const;
};

/// A task's plan in a scene from which nothing is taken yet.
struct TaskPlan {
  PlanInScene plan;
  std::vector<double> planned_mm3;  ///< that a burr can take, of each of its regions
  RemovalFollower untouched;
};

struct TaskInScene {
  TaskFile file;
  std::vector<RegionInScene> regions;                  ///< as file.regions
  std::vector<std::vector<bool>> forces, protections;  ///< by LabelId, as file.forces and file.protections
  std::vector<std::vector<bool>> metrics;              ///< likewise; empty: all
  std::optional<Eigen::Vector3d> answer_mm;            ///< centroid of what is to be found
  std::vector<bool> answer_labels;                     ///< by LabelId: what is to be found
  std::optional<ScopeSight> sight;
  std::optional<TaskPlan> plan;
};

/// Where a region is to be looked at, patient.
struct RegionView {
  Eigen::Vector3d middle_mm = Eigen::Vector3d::Zero();
  double radius_mm = 0;  ///< all of it lies so near to its middle
  /// Outwards of its surface where that is not covered by something felt, on average, unit; zero: no way is
  /// better than others.
  Eigen::Vector3d outward = Eigen::Vector3d::Zero();
};
RegionView view_of(const RegionInScene& region, const Model& model);
/// Likewise of what is to be taken off.
RegionView view_of(const RegionInPlan& region, const Model& model);

/// Errors: kBadInput with the line of a structure that the scene does not have, or of a region without a
/// place; with the task's name where something is to be taken off and no tool takes anything; kInterrupted.
/// @param model  with its labels; surfaces are taken where the proxy's are there, else the voxels' own faces
Result<TaskInScene> look_up(const TaskFile& task, const Model& model, const Progress& progress = {});

}  // namespace palpate
