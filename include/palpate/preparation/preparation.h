#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/sampling/sampling.h"
#include "palpate/volume/volume.h"

/// Whole-volume operations that turn labels or a scan into a Field. Seconds, once.
namespace palpate {

enum class GaussianEngine : std::uint8_t {
  kDirect,   ///< separable convolution in space, kernel cut at 4 sigma and normalised (default)
  kFourier,  ///< multiplication by exp(-2 pi^2 sigma^2 |nu|^2) in frequency, zero padded (as published)
};

struct GaussianOptions {
  double sigma_mm = 1.0;  ///< 0 ... 10 and at most 250 voxels; 0 leaves the values as they are
  GaussianEngine engine = GaussianEngine::kDirect;
  int threads = 0;  ///< 0: as many as the machine has; results do not depend on it
};

/// Smooths with a Gaussian of the same width in mm along every axis of the grid; voxels outside count
/// as 0. Input and output in the same unit. The result is the same bit for bit with any thread count
/// and SIMD target.
///
/// The direct kernel is the Gaussian sampled at whole voxels, as far as 4 sigma (rounded up to voxels),
/// normalised to sum 1. Not its integral over each voxel, which would widen it by 1/12 voxel^2 of
/// variance: sampled weights are what the filter in frequency amounts to. Where sigma is 1.5 voxels or
/// more on every axis the two engines differ by less than 0.05 of 255 on any volume; nearly all of that is
/// the cut, at most 0.016 an axis.
///
/// Errors: kBadInput for a sigma out of range, a negative number of threads, values that are not finite,
/// not enough memory; kInterrupted.
Result<Volume<float>> gaussian_smooth(const Volume<float>& volume, const GaussianOptions& options,
                                      const Progress& progress = {});
/// The same from bytes to bytes (0 ... 255, rounded to nearest). The direct engine needs no memory besides
/// input and output; the Fourier engine 4 bytes for every voxel of the volume with its margins.
Result<Volume<std::uint8_t>> gaussian_smooth(const Volume<std::uint8_t>& volume,
                                             const GaussianOptions& options, const Progress& progress = {});
/// From bytes to 16 bits: input 0 ... 255 becomes 0 ... 65535 (times 257), smoothed, rounded to nearest.
Result<Volume<std::uint16_t>> gaussian_smooth_16(const Volume<std::uint8_t>& volume,
                                                 const GaussianOptions& options,
                                                 const Progress& progress = {});

/// How far the two engines differ on one volume: of 255, before rounding. Below 1.5 sigma_voxels on an
/// axis they need not agree.
struct EngineDifference {
  double max_abs = 0;
  double mean_abs = 0;
  std::array<double, 3> sigma_voxels{0, 0, 0};  ///< along i, j, k
};
Result<EngineDifference> compare_gaussian_engines(const Volume<std::uint8_t>& volume, double sigma_mm,
                                                  const Progress& progress = {});

/// Each voxel's weight 0 ... 255 by its label: weights[id]; ids beyond the table weigh 0.
Volume<std::uint8_t> weigh_labels(const Volume<LabelId>& labels, const std::vector<std::uint8_t>& weights);

/// A ramp on a raw scan: 0 at or below `low`, 255 * weight at or above `high`, linear between
/// (direct contact with a scan that has no segmentation). Values that are no numbers give 0.
/// Requires low < high and 0 <= weight <= 1.
Volume<std::uint8_t> ramp_scan(const Volume<float>& scan, double low, double high, double weight = 1.0);

}  // namespace palpate
