#include "palpate/volume/gaussian_kernel.h"

#include <algorithm>
#include <cmath>
#include <sstream>

namespace palpate::internal {

AxisKernel sample_gaussian(double sigma_voxels, int reach) {
  if (sigma_voxels == 0) return {{1.0f}};
  const int radius = static_cast<int>(std::ceil(kCutSigmas * sigma_voxels));
  std::vector<double> samples(static_cast<std::size_t>(radius) + 1);
  double sum = 0;
  for (int t = radius; t >= 0; --t) {  // smallest first, for accuracy of the sum
    const double x = t / sigma_voxels;
    samples[t] = std::exp(-0.5 * x * x);
    sum += t == 0 ? samples[t] : 2 * samples[t];
  }
  AxisKernel kernel;
  for (int t = 0; t <= std::min(radius, reach); ++t) {
    kernel.weights.push_back(static_cast<float>(samples[t] / sum));
  }
  return kernel;
}

Result<std::array<double, 3>> sigma_in_voxels(const GridGeometry& grid, double sigma_mm) {
  if (!(sigma_mm >= 0 && sigma_mm <= kMaxSigma_mm)) {
    std::ostringstream what;
    what << "sigma is " << sigma_mm << " mm";
    return Error{ErrorKind::kBadInput, what.str(), "", "give a sigma of 0 to 10 mm"};
  }
  std::array<double, 3> sigma;
  for (int axis = 0; axis < 3; ++axis) {
    sigma[axis] = sigma_mm / grid.spacing_mm[axis];
    if (!(sigma[axis] <= kMaxSigmaVoxels)) {
      std::ostringstream what, remedy;
      what << "sigma of " << sigma_mm << " mm is " << sigma[axis] << " voxels along axis "
           << "ijk"[axis];
      remedy << "give at most " << kMaxSigmaVoxels << " voxels, or check the spacing ("
             << grid.spacing_mm[axis] << " mm)";
      return Error{ErrorKind::kBadInput, what.str(), "", remedy.str()};
    }
  }
  return sigma;
}

}  // namespace palpate::internal
