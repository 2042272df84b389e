#include "verification/stability_wall.h"

#include "palpate/loading/loading.h"
#include "palpate/scene/scene.h"

namespace palpate {
namespace {

/// The half up to x = 0 is wall.
/// @param across  number of voxels along y and z, odd
LabelMap wall_labels(double spacing_mm, int deep, int across) {
  GridGeometry grid;
  grid.dims = {2 * deep, across, across};
  grid.spacing_mm = Eigen::Vector3d::Constant(spacing_mm);
  const double side_mm = 0.5 * (across - 1) * spacing_mm;
  grid.origin = Point<Patient>((0.5 - deep) * spacing_mm, -side_mm, -side_mm);
  LabelMap labels;
  labels.layers.emplace_back(grid);
  labels.segments = {{1, "wall", {}, 0, 1}};
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) labels.layers[0].at(i, j, k) = i < deep ? 1 : 0;
  return labels;
}

}  // namespace

// deep enough for a pressing hand; the face is between two voxels
LabelMap flat_wall_labels() {
  return wall_labels(0.6, 20, 41);
}

LabelMap thick_wall_labels() {
  return wall_labels(0.8, 45, 61);
}

Result<std::shared_ptr<const Model>> flat_wall(const Progress& progress) {
  return one_bone(flat_wall_labels(), {ForceMethod::kProxy}, progress);
}

Result<std::shared_ptr<const Model>> one_bone(const LabelMap& labels, const std::vector<ForceMethod>& methods,
                                              const Progress& progress) {
  Scene scene;
  scene.title = labels.segments.front().name;
  TissueSettings bone;
  bone.name = "bone";
  bone.labels = {LabelReference{1}};
  bone.label_lines = {0};
  bone.stiffness_N_per_mm = 1;
  scene.tissues = {bone};
  const auto model = build_model(scene, &labels, nullptr, progress);
  if (!model) return model;
  return prepared_with_cache(*model, methods, progress);
}

}  // namespace palpate
