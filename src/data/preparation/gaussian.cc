#include <algorithm>
#include <cmath>
#include <new>

#include "palpate/volume/gaussian_kernel.h"
#include "preparation/fourier_gaussian.h"
#include "preparation/gaussian_direct.h"

namespace palpate {

namespace {

using internal::ProgressSpan;

bool all_finite(const Volume<float>& volume) {
  return std::all_of(volume.voxels().begin(), volume.voxels().end(),
                     [](float v) { return std::isfinite(v); });
}
bool all_finite(const Volume<std::uint8_t>&) {
  return true;
}

Error out_of_memory(std::size_t voxels) {
  return {ErrorKind::kBadInput, "not enough memory to smooth " + std::to_string(voxels) + " voxels", "",
          "close other programs, crop the volume, or use the direct engine, which needs the least"};
}

/// Validates the parameters, then smooths with the selected engine.
template <class In, class Out>
Result<Volume<Out>> smooth(const Volume<In>& volume, const GaussianOptions& options, const Progress& progress,
                           const ProgressSpan& span) {
  const auto sigma = internal::sigma_in_voxels(volume.geometry(), options.sigma_mm);
  if (!sigma) return sigma.error();
  if (options.threads < 0) {
    return Error{ErrorKind::kBadInput, "the number of threads is " + std::to_string(options.threads), "",
                 "give 0 for all processors, or at least 1"};
  }
  if (!all_finite(volume)) {
    return Error{ErrorKind::kBadInput, "the volume has values that are not finite", "",
                 "replace them (NaN, infinity) before smoothing"};
  }
  // with sigma 0 there is nothing to transform
  const bool fourier = options.engine == GaussianEngine::kFourier && options.sigma_mm > 0;
  const auto engine = fourier ? internal::smooth_fourier<In, Out> : internal::smooth_direct<In, Out>;
  try {
    return engine(volume, *sigma, options.threads, progress, span);
  } catch (const std::bad_alloc&) {
    return out_of_memory(volume.voxels().size());
  }
}

constexpr ProgressSpan kWhole{"smoothing"};

}  // namespace

Result<Volume<float>> gaussian_smooth(const Volume<float>& volume, const GaussianOptions& options,
                                      const Progress& progress) {
  return smooth<float, float>(volume, options, progress, kWhole);
}

Result<Volume<std::uint8_t>> gaussian_smooth(const Volume<std::uint8_t>& volume,
                                             const GaussianOptions& options, const Progress& progress) {
  return smooth<std::uint8_t, std::uint8_t>(volume, options, progress, kWhole);
}

Result<Volume<std::uint16_t>> gaussian_smooth_16(const Volume<std::uint8_t>& volume,
                                                 const GaussianOptions& options, const Progress& progress) {
  return smooth<std::uint8_t, std::uint16_t>(volume, options, progress, kWhole);
}

Result<EngineDifference> compare_gaussian_engines(const Volume<std::uint8_t>& volume, double sigma_mm,
                                                  const Progress& progress) {
  const ProgressSpan whole{"comparing engines"};
  GaussianOptions options{.sigma_mm = sigma_mm, .engine = GaussianEngine::kDirect};
  const auto direct = smooth<std::uint8_t, float>(volume, options, progress, whole.part(0, 0.3));
  if (!direct) return direct.error();
  options.engine = GaussianEngine::kFourier;
  const auto fourier = smooth<std::uint8_t, float>(volume, options, progress, whole.part(0.3, 1));
  if (!fourier) return fourier.error();

  EngineDifference difference;
  difference.sigma_voxels = internal::sigma_in_voxels(volume.geometry(), sigma_mm).value();
  double sum = 0;
  for (std::size_t n = 0; n < volume.voxels().size(); ++n) {
    const double d = std::abs(static_cast<double>(direct->voxels()[n]) - fourier->voxels()[n]);
    difference.max_abs = std::max(difference.max_abs, d);
    sum += d;
  }
  if (!volume.empty()) difference.mean_abs = sum / static_cast<double>(volume.voxels().size());
  return difference;
}

}  // namespace palpate
