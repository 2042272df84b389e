#pragma once

#include <memory>

#include "palpate/haptics/haptics.h"
#include "palpate/phantoms/primitives.h"

namespace palpate {

/// A solid voxelised by its voxels' centres, label 1, and what a scene's preparation makes of it.
class VoxelisedSolid {
 public:
  static Result<VoxelisedSolid> make(const Shape& shape, const GridGeometry& grid);

  /// Ready for every method, the field smoothed with `sigma_mm` and stored in 1 or 2 bytes a voxel.
  /// Errors: those of gaussian_smooth.
  Result<Model> prepared(double sigma_mm, int bytes_per_voxel) const;

 private:
  explicit VoxelisedSolid(std::shared_ptr<const Bricks<LabelId>> labels) : labels_(std::move(labels)) {}

  std::shared_ptr<const Bricks<LabelId>> labels_;
};

/// The same surface sampled exactly at every voxel's centre: neither voxelised nor filtered, so that what is
/// left of an error is storage and interpolation.
class ExactSolid {
 public:
  ExactSolid(const Shape& shape, const GridGeometry& grid);

  /// The normal distribution of -distance / sigma, 1 inside: what a flat surface becomes.
  Volume<float> ramp(double sigma_mm) const;
  /// The same as fractions of 255 or 65535.
  Field ramp_field(double sigma_mm, int bytes_per_voxel) const;
  /// The signed distance in steps of 0.0005 mm, held to 16 mm on either side.
  SignedField distance_field() const;

 private:
  Volume<float> distance_mm_;
};

}  // namespace palpate
