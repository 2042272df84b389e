#pragma once

#include "palpate/preparation/preparation.h"
#include "palpate/volume/slices.h"

namespace palpate::internal {

/// The published filter: transform, multiply by exp(-2 pi^2 sigma^2 |nu|^2), transform back. The volume
/// is padded with zeros by 5 sigma, so that what wraps round is below 1e-6 of full scale. Single
/// precision, by KissFFT. Types as smooth_direct.
template <class In, class Out>
Result<Volume<Out>> smooth_fourier(const Volume<In>& volume, const std::array<double, 3>& sigma_voxels,
                                   int threads, const Progress& progress, const ProgressSpan& span);

/// exp(-2 pi^2 sigma^2 nu^2) at the n frequencies of a transform of n points, in its order: 0, 1/n, ...
/// and from n/2 on the negative ones.
std::vector<float> gaussian_response(double sigma_voxels, int n);

}  // namespace palpate::internal
