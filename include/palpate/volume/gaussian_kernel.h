#pragma once

#include <array>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/volume/volume.h"

namespace palpate::internal {

/// One half of a symmetric kernel along one axis: weights[t] applies to the voxels at distance t.
/// weights[0] + 2 (weights[1] + weights[2] + ...) = 1.
///
/// The weights are samples of the Gaussian at integer distances, truncated at 4 sigma and normalised.
/// Integrating the Gaussian over each voxel instead would widen it: the variance would be sigma^2 + 1/12
/// voxel^2, whereas that of the samples is sigma^2 (to 2e-7 already at 1 voxel) less the 0.1 % lost to
/// truncation. Samples are also equivalent to the published filter in the frequency domain. Below 1.5 voxels
/// the two differ; compare_gaussian_engines reports by how much.
struct AxisKernel {
  std::vector<float> weights;
  int radius() const { return static_cast<int>(weights.size()) - 1; }
};

inline constexpr double kCutSigmas = 4;
inline constexpr double kMaxSigma_mm = 10;
/// Largest sigma accepted; voxels. No scan needs a wider kernel, and the Fourier engine's margins grow with
/// it.
inline constexpr double kMaxSigmaVoxels = 250;

/// Samples a Gaussian.
/// @param sigma_voxels  0 ... kMaxSigmaVoxels; 0 gives the kernel {1}
/// @param reach         largest distance whose weight is returned, voxels; farther weights are dropped after
///                      normalisation, because a row of n voxels uses at most n - 1
AxisKernel sample_gaussian(double sigma_voxels, int reach);

/// Sigma along i, j and k; voxels. Errors: kBadInput if sigma is NaN or out of range, in mm or in voxels.
Result<std::array<double, 3>> sigma_in_voxels(const GridGeometry& grid, double sigma_mm);

}  // namespace palpate::internal
