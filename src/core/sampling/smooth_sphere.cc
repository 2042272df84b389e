#include <algorithm>
#include <cmath>
#include <limits>

#include "sampling/label_sphere_query.h"

namespace palpate {

namespace {

/// Kernel along one axis around x, in double: weights with sum 1 and their derivatives by x.
struct LiteralWeights {
  LiteralWeights(double x, double radius) : start(static_cast<int>(std::floor(x - radius)) + 1) {
    double sum = 0, slope_sum = 0;
    for (int n = start; n < x + radius; ++n) {
      const double u = (n - x) / radius, t = 1 - u * u;
      weight.push_back(t * t * t);
      slope.push_back(6 * u * t * t / radius);
      sum += weight.back();
      slope_sum += slope.back();
    }
    for (std::size_t n = 0; n < weight.size(); ++n) {
      weight[n] /= sum;
      slope[n] = (slope[n] - weight[n] * slope_sum) / sum;
    }
  }
  int count() const { return static_cast<int>(weight.size()); }

  int start;
  std::vector<double> weight, slope;
};

}  // namespace

SmoothSphere::SmoothSphere(LabelVoxels voxels, const std::array<double, 3>& radius_voxels)
    : voxels_(std::move(voxels)), radius_voxels_(radius_voxels) {
  for (int axis = 0; axis < 3; ++axis) count_[axis] = static_cast<int>(std::ceil(2 * radius_voxels[axis]));
}

Result<SmoothSphere> SmoothSphere::make(LabelVoxels voxels, double sigma_mm) {
  if (!(sigma_mm > 0)) {
    return Error{ErrorKind::kBadInput,
                 "the smooth sphere's sigma of " + std::to_string(sigma_mm) + " mm is not above 0", "",
                 "choose a sigma in millimetres, 0.5 to 3 for most devices"};
  }
  std::array<double, 3> radius{};
  for (int axis = 0; axis < 3; ++axis) {
    radius[axis] =
        std::max(kMinRadiusVoxels, kRadiusPerSigma * sigma_mm / voxels.geometry().spacing_mm[axis]);
    if (!(radius[axis] <= kMaxRadiusVoxels)) {
      const double largest = kMaxRadiusVoxels * voxels.geometry().min_spacing_mm() / kRadiusPerSigma;
      return Error{
          ErrorKind::kBadInput,
          "the smooth sphere's sigma of " + std::to_string(sigma_mm) + " mm reaches more than 64 voxels", "",
          "choose a sigma up to " + std::to_string(largest) + " mm, or resample the labels to larger voxels"};
    }
  }
  return SmoothSphere(std::move(voxels), radius);
}

FieldSample SmoothSphere::sample(const Point<Patient>& x) const {
  FieldSample found;
  sample({&x, 1}, {&found, 1});
  return found;
}

void SmoothSphere::sample(std::span<const Point<Patient>> points, std::span<FieldSample> samples) const {
  if (count_ == std::array{4, 4, 4}) {
    return internal::label_sphere::sample_sphere_at(voxels_, internal::label_sphere::SmallKernel(), points,
                                                    samples);
  }
  internal::label_sphere::SmoothKernel kernel{};
  for (int axis = 0; axis < 3; ++axis) {
    kernel.radius[axis] = radius_voxels_[axis];
    kernel.per_radius[axis] = static_cast<float>(1 / radius_voxels_[axis]);
    kernel.count[axis] = count_[axis];
  }
  internal::label_sphere::sample_sphere_at(voxels_, kernel, points, samples);
}

double SmoothSphere::min_sigma_mm() const {
  const Eigen::Vector3d& spacing_mm = voxels_.geometry().spacing_mm;
  double min_mm = std::numeric_limits<double>::infinity();
  for (int axis = 0; axis < 3; ++axis)
    min_mm = std::min(min_mm, radius_voxels_[axis] * spacing_mm[axis] / kRadiusPerSigma);
  return min_mm;
}

FieldSample SmoothSphere::sample_literal(const Point<Patient>& x) const {
  const Point<Voxel> voxel = voxels_.X_VoxelPatient() * x;
  for (int axis = 0; axis < 3; ++axis) {
    const double reach = radius_voxels_[axis];
    if (!(voxel[axis] > -reach && voxel[axis] < voxels_.geometry().dims[axis] - 1 + reach)) return {};
  }
  const LiteralWeights wi(voxel.x(), radius_voxels_[0]), wj(voxel.y(), radius_voxels_[1]),
      wk(voxel.z(), radius_voxels_[2]);
  double value = 0;
  Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
  for (int k = 0; k < wk.count(); ++k) {
    for (int j = 0; j < wj.count(); ++j) {
      for (int i = 0; i < wi.count(); ++i) {
        if (!voxels_.contains(wi.start + i, wj.start + j, wk.start + k)) continue;
        value += wi.weight[i] * wj.weight[j] * wk.weight[k];
        gradient += Eigen::Vector3d(wi.slope[i] * wj.weight[j] * wk.weight[k],
                                    wi.weight[i] * wj.slope[j] * wk.weight[k],
                                    wi.weight[i] * wj.weight[j] * wk.slope[k]);
      }
    }
  }
  return {value, Vector<Patient>(voxels_.X_VoxelPatient().linear().transpose() * gradient)};
}

}  // namespace palpate
