#include "verification/accuracy_fields.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "palpate/preparation/preparation.h"
#include "verification/smoothed_indicator.h"

namespace palpate {
namespace {

template <class T>
Volume<T> in_steps_of_full_scale(const Volume<float>& ramp) {
  Volume<T> volume(ramp.geometry());
  std::transform(ramp.voxels().begin(), ramp.voxels().end(), volume.voxels().begin(), [](float value) {
    return static_cast<T>(std::lround(std::numeric_limits<T>::max() * static_cast<double>(value)));
  });
  return volume;
}

}  // namespace

Result<VoxelisedSolid> VoxelisedSolid::make(const Shape& shape, const GridGeometry& grid) {
  auto labels = voxelize_binary(shape, grid);
  if (!labels) return labels.error();
  return VoxelisedSolid(label_bricks(*labels));
}

Result<Model> VoxelisedSolid::prepared(double sigma_mm, int bytes_per_voxel) const {
  std::vector<std::uint8_t> weight_of(std::size_t{std::numeric_limits<LabelId>::max()} + 1, 255);
  weight_of[0] = 0;
  const auto binary = Bricks<std::uint8_t>::of_labels(*labels_, weight_of).dense();
  Model model;
  const auto keep = [&](auto&& smoothed) -> Result<void> {
    if (!smoothed) return smoothed.error();
    model.field = std::make_shared<const Field>(*std::forward<decltype(smoothed)>(smoothed));
    return {};
  };
  const auto stored = bytes_per_voxel == 1 ? keep(gaussian_smooth(binary, {.sigma_mm = sigma_mm}))
                                           : keep(gaussian_smooth_16(binary, {.sigma_mm = sigma_mm}));
  if (!stored) return stored.error();
  model.labels = labels_;
  model.tissues = {Tissue{}};
  model.tissue_of_label = {-1, 0};
  model.level_of_label = {0, 1};
  model.sigma_mm = sigma_mm;
  return model;
}

ExactSolid::ExactSolid(const Shape& shape, const GridGeometry& grid) : distance_mm_(grid) {
  const Transform<Patient, Voxel> X_PatientVoxel = grid.X_PatientVoxel();
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i)
        distance_mm_.at(i, j, k) =
            static_cast<float>(shape.distance_mm(X_PatientVoxel * Point<Voxel>(i, j, k)));
}

Volume<float> ExactSolid::ramp(double sigma_mm) const {
  Volume<float> ramp(distance_mm_.geometry());
  std::transform(distance_mm_.voxels().begin(), distance_mm_.voxels().end(), ramp.voxels().begin(),
                 [&](float distance) {
                   // beyond that the difference is less than float precision
                   if (std::abs(distance) > 6 * sigma_mm) return distance < 0 ? 1.f : 0.f;
                   return static_cast<float>(smoothed_half_space(distance, sigma_mm));
                 });
  return ramp;
}

Field ExactSolid::ramp_field(double sigma_mm, int bytes_per_voxel) const {
  const Volume<float> values = ramp(sigma_mm);
  return bytes_per_voxel == 1 ? Field(in_steps_of_full_scale<std::uint8_t>(values))
                              : Field(in_steps_of_full_scale<std::uint16_t>(values));
}

SignedField ExactSolid::distance_field() const {
  constexpr double kStep_mm = 0.0005;
  constexpr std::int16_t kMaxSteps = std::numeric_limits<std::int16_t>::max();
  Volume<std::int16_t> steps(distance_mm_.geometry());
  std::transform(distance_mm_.voxels().begin(), distance_mm_.voxels().end(), steps.voxels().begin(),
                 [](float distance) {
                   return static_cast<std::int16_t>(
                       std::clamp<long>(std::lround(distance / kStep_mm), -kMaxSteps, kMaxSteps));
                 });
  return {steps, {.scale = kStep_mm, .outside = kMaxSteps}};
}

}  // namespace palpate
