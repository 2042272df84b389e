#pragma once

#include <memory>

#include "palpate/volume/volume.h"

namespace palpate::bench {

/// A volume and its smoothed copy as ITK images, so that no conversion is timed.
class ItkGaussian {
 public:
  explicit ItkGaussian(const Volume<std::uint8_t>& volume);
  ~ItkGaussian();

  /// itk::SmoothingRecursiveGaussianImageFilter: Deriche's recursive approximation.
  void smooth_recursive(double sigma_mm, int threads);
  /// itk::DiscreteGaussianImageFilter: direct convolution.
  void smooth_discrete(double sigma_mm, int threads);
  /// Voxels of the last result, i varies fastest.
  const float* result() const;

 private:
  struct Images;
  std::unique_ptr<Images> images_;
};

}  // namespace palpate::bench
