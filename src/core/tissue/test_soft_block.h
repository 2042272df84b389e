#pragma once

#include <memory>

#include "contact/test_proxy_surfaces.h"
#include "palpate/contact/model.h"
#include "palpate/device/telemetry.h"

/// Soft tissue with a flat surface, and tools that press it, for tests.
namespace palpate::testing {

inline constexpr int kSoftBlockHalf = 40;  // mm; voxels of 1 mm

// Tissue of 10 kPa with its surface at z = 0, on a plate 20 mm below; optionally with a hard ball of 8 mm at
// 5 mm depth.
inline std::shared_ptr<const Model> soft_block(bool nodule, std::uint32_t version = 1,
                                               TissueLaw law = TissueLaw::kElastic) {
  auto model = std::make_shared<Model>();
  model->version = version;
  model->tissue_law = law;
  model->tissue_cell_mm = 1.5;
  GridGeometry grid = cube_grid(kSoftBlockHalf, {1, 1, 1});
  // the surface is between two voxels
  grid.origin = Point<Patient>(-kSoftBlockHalf, -kSoftBlockHalf, -kSoftBlockHalf - 0.5);
  Volume<LabelId> labels(grid);
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) {
        const Eigen::Vector3d p = (X_PatientVoxel * Point<Voxel>(i, j, k)).eigen();
        const bool hard = nodule && (p - Eigen::Vector3d(0, 0, -9)).norm() < 4;
        labels.at(i, j, k) = static_cast<LabelId>(p.z() > 0 ? 0 : p.z() < -20 ? 3 : hard ? 2 : 1);
      }
  model->labels = label_bricks(labels);
  Tissue tissue, ball, plate;
  tissue.elastic = ElasticConstants{10, 0.45};
  ball.elastic = ElasticConstants{100, 0.45};
  model->tissues = {tissue, ball, plate};
  model->tissue_of_label = {-1, 0, 1, 2};
  model->surfaces = {make_contact_surface(
      cube_grid(kSoftBlockHalf, {1, 1, 1}), [](const Eigen::Vector3d& p) { return p.z(); }, 12)};
  model->label_of_surface = {1};
  model->tools[0].radius_mm = 3;
  return model;
}

inline TickRecord tool_at(const Eigen::Vector3d& at, const Eigen::Vector3d& velocity_mm_s = {0, 0, 0}) {
  TickRecord record;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    record.device[0].tip_patient_mm[axis] = at[static_cast<Eigen::Index>(axis)];
    record.device[0].velocity_patient_mm_s[axis] = velocity_mm_s[static_cast<Eigen::Index>(axis)];
  }
  return record;
}

// a tool pressed in at that point
inline TickRecord pressed_at(double x, double y, double speed_x_mm_s = 0) {
  TickRecord record = tool_at({x, y, -1}, {speed_x_mm_s, 0, 0});
  DeviceTick& device = record.device[0];
  device.contact_label[0] = device.label = 1;
  device.contact_patient_mm = {x, y, 0};
  device.normal_patient = {0, 0, 1};
  device.contact_N[0] = 0.2;
  return record;
}

}  // namespace palpate::testing
