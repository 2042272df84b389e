#include "session/deformed_labels.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "palpate/rendering/rendering.h"
#include "palpate/tissue/displacement_field.h"

namespace palpate {
namespace {

/// Width of the margin around a solver grid over which boundary displacements fade to zero, in nodes; the
/// page does the same.
constexpr double kFadeNodes = 3;

DisplacementField moved_nodes(const ViewedDeformation& deformation, const Bricks<LabelId>& labels) {
  ElasticBox box;
  box.corner = {deformation.first_patient_mm[0], deformation.first_patient_mm[1],
                deformation.first_patient_mm[2]};
  for (std::size_t row = 0; row < 3; ++row)
    for (std::size_t column = 0; column < 3; ++column)
      box.axes(static_cast<Eigen::Index>(row), static_cast<Eigen::Index>(column)) =
          deformation.axes[3 * row + column];
  box.cell_mm = deformation.spacing_mm;
  for (std::size_t axis = 0; axis < 3; ++axis) box.cells[axis] = deformation.nodes[axis] - 1;
  const auto X_VoxelPatient = labels.geometry().X_PatientVoxel().inverse();
  const Eigen::Matrix3f to_axes = box.axes.transpose().cast<float>();
  std::vector<Eigen::Vector3f> moved_mm;
  std::vector<bool> empty;
  for (int k = 0; k < deformation.nodes[2]; ++k)
    for (int j = 0; j < deformation.nodes[1]; ++j)
      for (int i = 0; i < deformation.nodes[0]; ++i) {
        const float* const patient_mm = deformation.moved_mm.data() + 3 * moved_mm.size();
        const Eigen::Vector3f moved(patient_mm[0], patient_mm[1], patient_mm[2]);
        moved_mm.push_back(to_axes * moved);
        const Eigen::Vector3d at =
            (X_VoxelPatient * box.patient(box.cell_mm * Eigen::Vector3d(i, j, k))).eigen().array().round();
        // a node in material that has not moved at all is fixed, as bone is
        empty.push_back(moved.isZero(0) && labels.anywhere(static_cast<int>(at[0]), static_cast<int>(at[1]),
                                                           static_cast<int>(at[2])) == 0);
      }
  return {box, std::move(moved_mm), empty, kFadeNodes};
}

/// Enlarges a voxel box by the voxels that the nodes of a solver box may displace.
void widen(VoxelBox& within, const ElasticBox& box, const GridGeometry& grid) {
  const auto X_VoxelPatient = grid.X_PatientVoxel().inverse();
  for (int corner = 0; corner < 8; ++corner) {
    Eigen::Vector3d local;
    for (int axis = 0; axis < 3; ++axis)
      local[axis] =
          box.cell_mm *
          ((corner >> axis & 1) != 0 ? box.cells[static_cast<std::size_t>(axis)] + kFadeNodes : -kFadeNodes);
    const Eigen::Vector3d at = (X_VoxelPatient * box.patient(local)).eigen();
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double last = grid.dims[axis] - 1;
      const double voxel = std::clamp(at[static_cast<Eigen::Index>(axis)], 0.0, last);
      const bool is_first = within.size[axis] == 0;
      const int low = static_cast<int>(std::floor(voxel)), high = static_cast<int>(std::ceil(voxel)) + 1;
      const int end = is_first ? high : std::max(within.first[axis] + within.size[axis], high);
      within.first[axis] = is_first ? low : std::min(within.first[axis], low);
      within.size[axis] = end - within.first[axis];
    }
  }
}

}  // namespace

std::shared_ptr<const Bricks<LabelId>> DeformedLabels::of(const ViewerHost& host) {
  const std::shared_ptr<const Bricks<LabelId>> labels = host.labels();
  Deformations deformations;
  for (std::size_t device = 0; device < deformations.size(); ++device)
    deformations[device] = host.deformation(device);
  const std::lock_guard lock(mutex_);
  if (labels == labels_ && deformations == deformations_) return displayed_;
  std::vector<DisplacementField> nodes;
  VoxelBox within;
  for (const auto& deformation : deformations) {
    if (deformation == nullptr || deformation->moved_mm.empty()) continue;
    nodes.push_back(moved_nodes(*deformation, *labels));
    widen(within, nodes.back().box(), labels->geometry());
  }
  std::shared_ptr<const Bricks<LabelId>> displayed = labels;
  if (!nodes.empty()) {
    const auto moved = [&](const Point<Patient>& at_rest) {
      Vector<Patient> moved_mm;
      for (const DisplacementField& one : nodes) one.add_displacement(at_rest, moved_mm);
      return moved_mm;
    };
    const PatchOf<LabelId> patch = moved_labels(*labels, moved, within);
    if (patch.box.voxel_count() > 0) displayed = std::make_shared<Bricks<LabelId>>(labels->with(patch));
  }
  labels_ = labels;
  deformations_ = std::move(deformations);
  displayed_ = displayed;
  return displayed;
}

}  // namespace palpate
