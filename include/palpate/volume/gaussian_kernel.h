#pragma once

#include <array>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/volume/volume.h"

namespace palpate::internal {

/// One side of a symmetric kernel along one axis: weights[t] belongs to the voxels at distance t.
/// weights[0] + 2 (weights[1] + weights[2] + ...) = 1.
///
/// The weights are samples of the Gaussian at whole voxels, cut at 4 sigma and normalised. Integrating
/// the Gaussian over each voxel instead would widen it: the variance would be sigma^2 + 1/12 voxel^2,
/// whereas that of the samples is sigma^2 (to 2e-7 already at 1 voxel) less the 0.1 % that the cut takes.
/// Samples are also what the published filter in frequency amounts to. Below 1.5 voxels the two part:
/// there compare_gaussian_engines says by how much.
struct AxisKernel {
  std::vector<float> weights;
  int radius() const { return static_cast<int>(weights.size()) - 1; }
};

inline constexpr double kCutSigmas = 4;
inline constexpr double kMaxSigma_mm = 10;
/// Wider kernels than this are refused: no scan needs one, and the Fourier engine's margins grow with it.
inline constexpr double kMaxSigmaVoxels = 250;

/// @param sigma_voxels  0 ... kMaxSigmaVoxels; 0 gives the kernel {1}
/// @param reach         weights beyond it are left out, after normalising: a row of n voxels has no use
///                      for more than n - 1
AxisKernel sample_gaussian(double sigma_voxels, int reach);

/// Sigma along i, j and k. Error kBadInput when sigma is no number or out of range, in mm or in voxels.
Result<std::array<double, 3>> sigma_in_voxels(const GridGeometry& grid, double sigma_mm);

}  // namespace palpate::internal
