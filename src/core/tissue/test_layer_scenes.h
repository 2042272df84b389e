#pragma once

#include <memory>

#include "contact/test_proxy_surfaces.h"
#include "palpate/contact/model.h"
#include "palpate/device/telemetry.h"

/// A flat layer of soft tissue on bone, and tools that press it, for tests.
namespace palpate::testing {

struct LayerScene {
  double thickness_mm = 3, modulus_kPa = 9, poissons_ratio = 0.45;
  double skin_mm = 0, skin_modulus_kPa = 90;  ///< Uppermost part of the layer
  double cell_mm = 1, tool_mm = 3;
  bool base = true;  ///< Without it there is air below the layer
  TissueLaw law = TissueLaw::kElastic;
};

inline constexpr double kLayerVoxel_mm = 0.5;

/// Surface at z = 0; voxels of 0.5 mm, 40 mm wide.
inline std::shared_ptr<const Model> layer_block(const LayerScene& scene) {
  constexpr int kAcross = 80, kBelow = 60, kAbove = 4;
  auto model = std::make_shared<Model>();
  model->version = 1;
  model->tissue_law = scene.law;
  model->tissue_cell_mm = scene.cell_mm;
  GridGeometry grid;
  grid.dims = {kAcross, kAcross, kBelow + kAbove};
  grid.spacing_mm = {kLayerVoxel_mm, kLayerVoxel_mm, kLayerVoxel_mm};
  // the surface is between two voxels
  grid.origin = Point<Patient>(-0.5 * (kAcross - 1) * kLayerVoxel_mm, -0.5 * (kAcross - 1) * kLayerVoxel_mm,
                               (0.5 - kBelow) * kLayerVoxel_mm);
  Volume<LabelId> labels(grid);
  for (int k = 0; k < grid.dims[2]; ++k) {
    const double z = (k + 0.5 - kBelow) * kLayerVoxel_mm;
    const int label = z > 0 ? 0 : z > -scene.skin_mm ? 2 : z > -scene.thickness_mm ? 1 : scene.base ? 3 : 0;
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) labels.at(i, j, k) = static_cast<LabelId>(label);
  }
  model->labels = label_bricks(labels);
  Tissue fat, skin, bone;
  fat.elastic = ElasticConstants{scene.modulus_kPa, scene.poissons_ratio};
  skin.elastic = ElasticConstants{scene.skin_modulus_kPa, scene.poissons_ratio};
  model->tissues = {fat, skin, bone};
  model->tissue_of_label = {-1, 0, 1, 2};
  model->level_of_label = {0, 1, 1, 1};
  model->surfaces = {make_contact_surface(
      cube_grid(24, {1, 1, 1}), [](const Eigen::Vector3d& p) { return p.z(); }, 14)};
  model->surfaces[0].plane_strain_modulus_N_per_mm2 = contact_modulus_N_per_mm2(*fat.elastic);
  model->label_of_surface = {1};
  model->tools[0].radius_mm = scene.tool_mm;
  return model;
}

/// Tick of a tool at rest at that depth.
inline TickRecord layer_pressed(double depth_mm, double force_N) {
  TickRecord record;
  DeviceTick& device = record.device[0];
  device.contact_label[0] = device.label = 1;
  device.normal_patient = {0, 0, 1};
  device.depth_mm = depth_mm;
  device.contact_N[0] = force_N;
  device.tip_patient_mm = {0, 0, -depth_mm};
  return record;
}

}  // namespace palpate::testing
