#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/sampling/sampling.h"
#include "palpate/volume/volume.h"

/// Whole-volume operations that convert labels or a scan to a Field. They take seconds and run once.
namespace palpate {

enum class GaussianEngine : std::uint8_t {
  kDirect,  ///< Separable convolution, kernel truncated at 4 sigma and normalised (default)
  /// Multiplication by exp(-2 pi^2 sigma^2 |nu|^2) in the frequency domain, zero padded (as published)
  kFourier,
};

struct GaussianOptions {
  double sigma_mm = 1.0;  ///< 0 ... 10 and at most 250 voxels; 0 leaves the values unchanged
  GaussianEngine engine = GaussianEngine::kDirect;
  int threads = 0;  ///< 0: number of cores; the result does not depend on it
};

/// Gaussian smoothing with the same width in mm along every grid axis. Voxels outside the volume count as 0.
/// Values keep their unit. The result is bit-identical for any thread count and SIMD target.
///
/// The direct kernel is the Gaussian sampled at whole voxels up to 4 sigma (rounded up to voxels) and
/// normalised to sum 1. It is not integrated over each voxel, which would add 1/12 voxel^2 of variance: the
/// Fourier filter corresponds to sampled weights. Where sigma is at least 1.5 voxels on every axis, the two
/// engines differ by less than 0.05 of 255 on any volume; nearly all of that is due to truncation, at most
/// 0.016 per axis.
///
/// Errors: kBadInput for a sigma out of range, a negative number of threads, non-finite values or
/// insufficient memory; kInterrupted.
Result<Volume<float>> gaussian_smooth(const Volume<float>& volume, const GaussianOptions& options,
                                      const Progress& progress = {});
/// Byte input and output (0 ... 255, rounded to nearest). The direct engine needs no memory besides input and
/// output; the Fourier engine needs 4 bytes per voxel of the padded volume.
Result<Volume<std::uint8_t>> gaussian_smooth(const Volume<std::uint8_t>& volume,
                                             const GaussianOptions& options, const Progress& progress = {});
/// Byte input, 16-bit output: 0 ... 255 is scaled to 0 ... 65535 (times 257), smoothed and rounded to
/// nearest.
Result<Volume<std::uint16_t>> gaussian_smooth_16(const Volume<std::uint8_t>& volume,
                                                 const GaussianOptions& options,
                                                 const Progress& progress = {});

/// Difference between the two engines on one volume, in units of 1/255, before rounding. They need not agree
/// if sigma is below 1.5 voxels on any axis.
struct EngineDifference {
  double max_abs = 0;
  double mean_abs = 0;
  std::array<double, 3> sigma_voxels{0, 0, 0};  ///< Standard deviation along i, j, k, in voxels
};
/// Smooths a volume with both engines and compares the results. Errors: those of gaussian_smooth.
Result<EngineDifference> compare_gaussian_engines(const Volume<std::uint8_t>& volume, double sigma_mm,
                                                  const Progress& progress = {});

/// Maps each label to its weight 0 ... 255: weights[id], and 0 for ids beyond the table.
Volume<std::uint8_t> weigh_labels(const Volume<LabelId>& labels, const std::vector<std::uint8_t>& weights);

/// Linear ramp on a raw scan: 0 at or below `low`, 255 * weight at or above `high` (direct contact with a
/// scan that has no segmentation). NaN gives 0. Requires low < high and 0 <= weight <= 1.
Volume<std::uint8_t> ramp_scan(const Volume<float>& scan, double low, double high, double weight = 1.0);

}  // namespace palpate
