#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/haptics/haptics.h"
#include "palpate/scene/plan_file.h"
#include "palpate/tissue/removed_volume.h"

/// A plan whose structures were looked up in a scene.
namespace palpate {

/// A PlanRegion where it lies in the patient.
class RegionInPlan {
 public:
  /// @param has_label  by LabelId: of these structures alone; empty: of all
  RegionInPlan(const PlanFile& plan, const PlanRegion& region, std::vector<bool> has_label);

  /// mm: how deep a place lies in the shape, negative outside; outside it is the distance to it with a minus.
  /// Infinite where the region is all of some structures.
  double depth_mm(const Point<Patient>& at) const;
  bool has(LabelId label) const {
    return has_label_.empty() || (label < has_label_.size() && has_label_[label]);
  }
  /// Which of the places of a voxel (RemovedVolume) lie in it. @param label  of the voxel
  std::uint64_t places_in(const GridGeometry& grid, int i, int j, int k, LabelId label) const;

 private:
  PlanShape shape_;
  std::vector<bool> has_label_;
  Point<Patient> middle_;
  Vector<Patient> axis_, across_, third_;  // unit, perpendicular
  double radius_mm_;
  Eigen::Vector3d half_mm_;  // along axis_, across_, third_
};

struct PlanInScene {
  PlanFile file;
  std::vector<std::vector<bool>> enters;   ///< by LabelId, as file.trajectories; empty: the entry is a place
  std::vector<RegionInPlan> regions;       ///< as file.regions
  std::map<LabelId, double> distances_mm;  ///< to keep away; the greatest where a structure is named twice
};

/// Errors: kBadInput with the line of a structure that the scene does not have, or that has no voxel, and for
/// a model without labels.
Result<PlanInScene> look_up_plan(const PlanFile& plan, const Model& model);

/// mm3 of what a burr could take off, by structure.
using VolumesByLabel = std::map<LabelId, double>;
struct PlannedVolumes {
  std::vector<VolumesByLabel> of_regions;  ///< as PlanInScene::regions
  VolumesByLabel of_plan;                  ///< of all regions together; what lies in two of them counts once
};
/// What the plan asks to be taken off, by 64 places of each voxel, of structures that are felt and not kept
/// from a burr: of others nothing can be taken. Errors: kInterrupted.
Result<PlannedVolumes> planned_volumes(const PlanInScene& plan, const Model& model,
                                       const Progress& progress = {});

/// What was taken, of that.
struct TakenVolumes {
  PlannedVolumes in_plan;
  VolumesByLabel outside;  ///< of all regions
};
TakenVolumes taken_volumes(const PlanInScene& plan, const RemovedVolume& removed);
/// How far what was taken lies from the nearest of the plan's shapes where it lies outside of all, the
/// greatest distance, mm; 0 where nothing does. By the 64 places of each voxel: up to half of what lies
/// between two of them less than it was.
double depth_past_plan_mm(const PlanInScene& plan, const RemovedVolume& removed);

}  // namespace palpate
