#pragma once

#include <memory>

#include "palpate/contact/model.h"
#include "palpate/phantoms/primitives.h"

namespace palpate {

/// A solid voxelised by voxel centres with label 1, and the model that scene preparation makes of it.
class VoxelisedSolid {
 public:
  static Result<VoxelisedSolid> make(const Shape& shape, const GridGeometry& grid);

  /// Model that is ready for every method, with the field smoothed with `sigma_mm` and stored with 1 or 2
  /// bytes per voxel. Errors: those of gaussian_smooth.
  Result<Model> prepared(double sigma_mm, int bytes_per_voxel) const;

 private:
  explicit VoxelisedSolid(std::shared_ptr<const Bricks<LabelId>> labels) : labels_(std::move(labels)) {}

  std::shared_ptr<const Bricks<LabelId>> labels_;
};

/// The same surface sampled exactly at every voxel centre, neither voxelised nor filtered, so that the
/// remaining error is that of storage and interpolation.
class ExactSolid {
 public:
  ExactSolid(const Shape& shape, const GridGeometry& grid);

  /// Normal distribution function of -distance / sigma, 1 inside: exact for a flat surface.
  Volume<float> ramp(double sigma_mm) const;
  /// The ramp quantised to multiples of 1/255 or 1/65535.
  Field ramp_field(double sigma_mm, int bytes_per_voxel) const;
  /// Signed distance in steps of 0.0005 mm, clamped to 16 mm on either side.
  SignedField distance_field() const;

 private:
  Volume<float> distance_mm_;
};

}  // namespace palpate
