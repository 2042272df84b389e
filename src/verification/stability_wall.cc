#include "verification/stability_wall.h"

#include "palpate/loading/loading.h"
#include "palpate/scene/scene.h"

namespace palpate {

LabelMap flat_wall_labels() {
  // deep enough for a hand that leans on it, the face between two voxels
  constexpr double kSpacing_mm = 0.6;
  GridGeometry grid;
  grid.dims = {40, 41, 41};
  grid.spacing_mm = Eigen::Vector3d::Constant(kSpacing_mm);
  grid.origin = Point<Patient>(-19.5 * kSpacing_mm, -20 * kSpacing_mm, -20 * kSpacing_mm);
  LabelMap labels;
  labels.layers.emplace_back(grid);
  labels.segments = {{1, "wall", {}, 0, 1}};
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) labels.layers[0].at(i, j, k) = i < grid.dims[0] / 2 ? 1 : 0;
  return labels;
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
  return ready_for(*model, methods, progress);
}

}  // namespace palpate
