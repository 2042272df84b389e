#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "palpate/contact/model.h"
#include "palpate/rehearsal/structure_distance.h"
#include "palpate/rehearsal/tool_head.h"
#include "palpate/scene/task_file.h"
#include "palpate/tissue/removed_volume.h"

/// Measures of a running burr near structures, and of its visibility to an operating microscope.
namespace palpate {

/// Distances of the structures of a metric, before any removal.
using StructureDistances = std::shared_ptr<const std::vector<StructureDistance>>;

/// Smallest distance of removed tissue from the structures' surfaces, mm; negative: the depth to which they
/// were cut. NaN: nothing was removed. Sampled at the 64 points of each voxel.
double bone_left_mm(const std::vector<StructureDistance>& structures, const RemovedVolume& removed);

/// Follows the head of a running burr near some structures.
class BurrNearStructures {
 public:
  /// @param within_mm  distance of the head within which the force counts
  BurrNearStructures(StructureDistances structures, double within_mm)
      : structures_(std::move(structures)), within_mm_(within_mm) {}

  /// Processes a tick in which the motor runs.
  /// @param force_N  normal force sent
  void observe(const ToolHead& head, double force_N);
  /// Smallest distance of the head; NaN before the first tick.
  double nearest_mm() const { return nearest_mm_; }
  /// Greatest force within `within_mm`; 0 if the head has never been there.
  double peak_N() const { return peak_N_; }

 private:
  StructureDistances structures_;
  double within_mm_;
  double nearest_mm_ = kNoValue, peak_N_ = 0;
  // last evaluation, from which the distance has changed by at most the displacement of the head
  std::optional<ToolHead> head_;
  double gap_mm_ = 0;
};

/// Decides whether an operating microscope sees a burr's head. The head is seen if a straight line from its
/// centre to the microscope, in the microscope's direction or tilted from it, meets no touchable tissue that
/// has not been removed. 17 directions are tried: the axis, and eight each at half the tilt and at the tilt.
class MicroscopeView {
 public:
  MicroscopeView(const TaskMicroscope& microscope, const Model& model);

  bool is_visible(const ToolHead& head, const RemovedVolume& removed) const;

 private:
  bool is_free(const Point<Patient>& from, const Vector<Patient>& direction, double begins_mm,
               const RemovedVolume& removed) const;

  std::shared_ptr<const Bricks<LabelId>> labels_;
  std::vector<bool> is_touchable_;  // by label
  std::vector<Vector<Patient>> directions_;
  Transform<Voxel, Patient> X_VoxelPatient_;
  double step_mm_;      // spacing of the points of a line of sight
  double uncarved_mm_;  // distance around the head in which cuts may not have been reported yet
};

}  // namespace palpate
