#pragma once

#include <cmath>
#include <memory>

#include "contact/test_proxy_surfaces.h"
#include "palpate/contact/model.h"
#include "palpate/direct/direct_methods.h"

/// Analytic model for tests: a ball of bone at the patient's origin, optionally with a shell of cartilage.
/// The field is an ideal Gaussian ramp sampled at voxel centres.
namespace palpate::testing {

inline constexpr double kBoneRadius_mm = 15;
inline constexpr LabelId kBone = 5, kCartilage = 7, kFat = 9;

inline double ramp(double distance_mm, double sigma_mm) {
  return 0.5 * std::erfc(distance_mm / (sigma_mm * std::sqrt(2.0)));
}

/// @param cartilage_mm     thickness of the shell; 0: none
/// @param cartilage_level  stiffness of cartilage over that of bone
inline Model ball_model(const Eigen::Vector3d& spacing_mm = {0.6, 0.6, 0.9}, double sigma_mm = 1.0,
                        double cartilage_mm = 0, float cartilage_level = 0.5f) {
  GridGeometry grid;
  for (int axis = 0; axis < 3; ++axis) grid.dims[axis] = static_cast<int>(60 / spacing_mm[axis]) | 1;
  grid.spacing_mm = spacing_mm;
  const Eigen::Vector3d corner =
      -0.5 * (Eigen::Vector3d(grid.dims[0] - 1, grid.dims[1] - 1, grid.dims[2] - 1).cwiseProduct(spacing_mm));
  grid.origin = Point<Patient>(corner);

  Model model;
  model.sigma_mm = sigma_mm;
  model.reach_mm = 4 * sigma_mm + spacing_mm.maxCoeff();
  Tissue bone;
  bone.name = "bone";
  bone.stiffness_N_per_mm = 1.5;
  Tissue cartilage;
  cartilage.name = "cartilage";
  cartilage.stiffness_N_per_mm = 1.5 * cartilage_level;
  cartilage.rests_on = {0};
  Tissue fat;
  fat.name = "fat";
  fat.touchable = false;
  model.tissues = {bone, cartilage, fat};
  model.segments = {
      {kBone, "ball", {}, 0, kBone}, {kCartilage, "shell", {}, 0, kCartilage}, {kFat, "fat", {}, 0, kFat}};
  model.tissue_of_label.assign(kFat + 1, -1);
  model.level_of_label.assign(kFat + 1, 0.f);
  model.tissue_of_label[kBone] = 0;
  model.tissue_of_label[kCartilage] = 1;
  model.tissue_of_label[kFat] = 2;
  model.level_of_label[kBone] = 1.f;
  model.level_of_label[kCartilage] = cartilage_level;

  Volume<std::uint16_t> field(grid);
  Volume<LabelId> labels(grid);
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) {
        const double r = (X_PatientVoxel * Point<Voxel>(i, j, k)).eigen().norm();
        const double bone_part = ramp(r - kBoneRadius_mm, sigma_mm);
        const double shell_part =
            cartilage_mm > 0 ? ramp(r - kBoneRadius_mm - cartilage_mm, sigma_mm) - bone_part : 0;
        field.at(i, j, k) =
            static_cast<std::uint16_t>(std::lround(65535 * (bone_part + cartilage_level * shell_part)));
        labels.at(i, j, k) = r < kBoneRadius_mm                  ? kBone
                             : r < kBoneRadius_mm + cartilage_mm ? kCartilage
                             : r < 24                            ? kFat
                                                                 : LabelId{0};
      }
  model.field = std::make_shared<const Field>(std::move(field));
  model.labels = label_bricks(labels);
  model.methods[0] = *make_force_field(model, ForceMethod::kTrilinear);
  model.X_WorldPatient = supine_from_feet(grid);
  return model;
}

/// The ball with inward ramps as its field, exact at voxel centres.
inline Model with_ramps(Model model, double width_mm, double cartilage_mm = 0) {
  const GridGeometry& grid = model.labels->geometry();
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  const double bone = model.tissues[0].stiffness_N_per_mm, cartilage = model.tissues[1].stiffness_N_per_mm;
  Volume<std::uint16_t> field(grid);
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) {
        const double depth_mm = kBoneRadius_mm - (X_PatientVoxel * Point<Voxel>(i, j, k)).eigen().norm();
        const double force_N = cartilage_mm == 0 ? bone * std::max(0.0, depth_mm)
                                                 : cartilage * std::max(0.0, depth_mm + cartilage_mm) +
                                                       (bone - cartilage) * std::max(0.0, depth_mm);
        field.at(i, j, k) =
            static_cast<std::uint16_t>(std::lround(65535 * std::min(1.0, force_N / (bone * width_mm))));
      }
  model.field = std::make_shared<const Field>(std::move(field));
  model.ramp_width_mm = width_mm;
  model.reach_mm = 12 + grid.spacing_mm.maxCoeff();
  model.methods[0] = *make_force_field(model, ForceMethod::kTrilinear);
  return model;
}

/// Sets the force of the trilinear method at field value 1.
inline void set_full_force(Model& model, double full_force_N) {
  model.methods[0] = std::make_shared<const ForceField>(model.field, full_force_N);
}

/// The model with every direct method prepared.
inline Model with_every_method(Model model) {
  for (const ForceMethodInfo& info : kDirectMethods)
    model.methods[index_of(info.method)] = *make_force_field(model, info.method);
  return model;
}

/// The model with exact surfaces for the proxy: the ball of bone, and its shell if there is one.
inline Model with_exact_surfaces(Model model, double cartilage_mm = 0) {
  const GridGeometry& grid = model.labels->geometry();
  const auto add = [&](LabelId label, const Distance& distance_mm) {
    const SignedField field = sampled_distance(grid, distance_mm, 4);
    const Tissue& tissue = *model.tissue_of(label);
    model.surfaces.push_back({static_cast<const ContactProperties&>(tissue),
                              std::make_shared<const Surface>(field, field, steepest_of(field)),
                              tissue.puncture_N});
    model.surfaces.back().cutting_energy_mJ_per_mm3 = tissue.cutting_energy_mJ_per_mm3;
    model.label_of_surface.push_back(label);
  };
  add(kBone, [](const Eigen::Vector3d& p) { return p.norm() - kBoneRadius_mm; });
  if (cartilage_mm > 0)
    add(kCartilage, [&](const Eigen::Vector3d& p) {
      const double half_mm = 0.5 * cartilage_mm;
      return std::abs(p.norm() - kBoneRadius_mm - half_mm) - half_mm;
    });
  return model;
}

/// with_exact_surfaces() with a common outer surface, and bone in the next layer. Bone reaches the outer
/// surface where x > 0, so the seam is at the origin, where tips often are.
inline Model as_one_body(Model model, double cartilage_mm) {
  model = with_exact_surfaces(std::move(model), cartilage_mm);
  Volume<LabelId> observed = model.labels->dense();
  const auto X_PatientVoxel = observed.geometry().X_PatientVoxel();
  const auto& dims = observed.geometry().dims;
  for (int k = 0; k < dims[2]; ++k)
    for (int j = 0; j < dims[1]; ++j)
      for (int i = 0; i < dims[0]; ++i) {
        LabelId& label = observed.at(i, j, k);
        if (label == kCartilage && (X_PatientVoxel * Point<Voxel>(i, j, k)).x() > 0) label = kBone;
      }
  std::vector<std::int16_t> structure_of_label(
      *std::max_element(observed.voxels().begin(), observed.voxels().end()) + 1u, -1);
  structure_of_label[kBone] = 0;
  structure_of_label[kCartilage] = 1;
  const SignedField field = sampled_distance(
      observed.geometry(), [&](const Eigen::Vector3d& p) { return p.norm() - kBoneRadius_mm - cartilage_mm; },
      4);
  ContactSurface outer;
  outer.surface = std::make_shared<const Surface>(field, field, steepest_of(field));
  outer.owners = std::make_shared<const Owners>(*label_bricks(observed), structure_of_label);
  outer.upper_N_per_mm = model.surfaces[1].stiffness_N_per_mm;
  model.surfaces[0].lower_N_per_mm = outer.upper_N_per_mm;
  model.surfaces[0].layer = 1;
  model.surfaces[1].surface = nullptr;
  model.surfaces.push_back(outer);
  return model;
}

}  // namespace palpate::testing
