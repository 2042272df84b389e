#pragma once

#include "palpate/preparation/preparation.h"
#include "palpate/volume/slices.h"

namespace palpate::internal {

/// The published filter: transform, multiply by exp(-2 pi^2 sigma^2 |nu|^2), inverse transform. The volume is
/// zero padded by 5 sigma, so that wrap-around is below 1e-6 of full scale. Single precision, by KissFFT.
/// Types as for smooth_direct.
template <class In, class Out>
Result<Volume<Out>> smooth_fourier(const Volume<In>& volume, const std::array<double, 3>& sigma_voxels,
                                   int threads, const Progress& progress, const ProgressSpan& span);

/// exp(-2 pi^2 sigma^2 nu^2) at the n frequencies of a transform of n points, in FFT order: 0, 1/n, ..., the
/// negative ones from n/2 on.
std::vector<float> gaussian_response(double sigma_voxels, int n);

}  // namespace palpate::internal
