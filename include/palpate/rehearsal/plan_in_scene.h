#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/contact/model.h"
#include "palpate/scene/plan_file.h"
#include "palpate/tissue/removed_volume.h"

/// A plan with its structures resolved in a scene.
namespace palpate {

/// A PlanRegion in the patient frame.
class RegionInPlan {
 public:
  /// @param has_label  structures that the region is restricted to, by LabelId; empty: all
  RegionInPlan(const PlanFile& plan, const PlanRegion& region, std::vector<bool> has_label);

  /// Depth of a point within the shape, mm; outside the negated distance to it. Infinite if the region
  /// consists of whole structures.
  double depth_mm(const Point<Patient>& at) const;
  bool has(LabelId label) const {
    return has_label_.empty() || (label < has_label_.size() && has_label_[label]);
  }
  /// Bit set of the sample points of a voxel (RemovedVolume) that are in the region.
  /// @param label  label of the voxel
  std::uint64_t samples_in(const GridGeometry& grid, int i, int j, int k, LabelId label) const;

 private:
  PlanShape shape_;
  std::vector<bool> has_label_;
  Point<Patient> middle_;
  Vector<Patient> axis_, across_, third_;  // unit, mutually perpendicular
  double radius_mm_;
  Eigen::Vector3d half_mm_;  // along axis_, across_, third_
};

/// A plan with its structures and regions resolved in a scene.
struct PlanInScene {
  PlanFile file;
  /// Structures that each trajectory enters, by LabelId, in the order of file.trajectories; empty: the entry
  /// is a free point
  std::vector<std::vector<bool>> enters;
  std::vector<RegionInPlan> regions;       ///< Regions, in the order of file.regions
  std::map<LabelId, double> distances_mm;  ///< Required clearance; the largest if a structure is named twice
};

/// Resolves a plan in a model. Errors: kBadInput with the line of a structure that is absent or has no voxel,
/// and for a model without labels.
Result<PlanInScene> resolve_plan(const PlanFile& plan, const Model& model);

/// Removable volume by structure, mm3.
using VolumesByLabel = std::map<LabelId, double>;
struct PlannedVolumes {
  std::vector<VolumesByLabel> of_regions;  ///< Volumes of each region, in the order of PlanInScene::regions
  VolumesByLabel of_plan;                  ///< Union of all regions; overlaps count once
};
/// Volumes to remove according to the plan, from 64 sample points per voxel. Only touchable structures that
/// are not protected from burrs are counted, because others cannot be removed. Errors: kInterrupted.
Result<PlannedVolumes> planned_volumes(const PlanInScene& plan, const Model& model,
                                       const Progress& progress = {});

/// Removed volume within and outside the plan.
struct RemovedVolumes {
  PlannedVolumes in_plan;
  VolumesByLabel outside;  ///< Outside all regions
};
/// Volumes of `removed` within each region, within the plan and outside it, by structure.
RemovedVolumes removed_volumes(const PlanInScene& plan, const RemovedVolume& removed);
/// Maximum distance of removed tissue outside all regions from the nearest of the plan's shapes, mm; 0 if
/// there is none. Sampled at the 64 points of each voxel, so it is underestimated by up to half their
/// spacing.
double depth_past_plan_mm(const PlanInScene& plan, const RemovedVolume& removed);

}  // namespace palpate
