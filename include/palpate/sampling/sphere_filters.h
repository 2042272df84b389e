#pragma once

#include <array>
#include <span>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/sampling/label_voxels.h"
#include "palpate/sampling/sampling.h"

/// Sphere filters: force methods on raw labels, without a prepared field. Each gives value and gradient at a
/// point (sampling.h). The literal form in double is its definition; the vector form is the one used in a
/// tick. The vector form is bit-identical on every SIMD target and in every build, for a single point and for
/// batches, and does not allocate, lock or throw. Points outside the volume, or with a NaN coordinate, are
/// free space with value 0.
namespace palpate {

/// The founding Gaussian sphere, exactly as published (MERL c. 1997), including its discontinuities:
///
///   I(x) = sum over i, j, k = -2 ... 2 of (2 pi sigma^2)^(-3/2) exp(-d^2 / 2 sigma^2) L([x]+i, [y]+j, [z]+k)
///
/// where x and sigma are in voxels, [.] is the nearest voxel (halves round up), d^2 the squared distance from
/// that voxel to x, and L is 1 in the set and 0 elsewhere. The sum of the weights is not constant (0.97 at
/// sigma 1 at a voxel's centre), and the window jumps by a voxel wherever x crosses a half voxel. The
/// gradient is half the difference of the values one voxel away along each axis of the grid, transformed to
/// mm by the inverse transpose of the voxel matrix.
class GaussianSphere {
 public:
  static constexpr double kMinSigmaVoxels = 0.5, kMaxSigmaVoxels = 2;

  /// Errors: kBadInput if sigma_voxels is outside 0.5 ... 2.
  static Result<GaussianSphere> make(LabelVoxels voxels, double sigma_voxels = 1);

  /// Value and gradient, within 1e-5 of the literal form. The weights are shared by all seven evaluations,
  /// which are whole voxels apart, and factorised as exp(-dx^2) exp(-dy^2) exp(-dz^2), each factor
  /// interpolated linearly in a table over the fraction of x (steps of 1/512 voxel).
  FieldSample sample(const Point<Patient>& x) const;
  /// Batch version; `samples` and `points` have the same size.
  void sample(std::span<const Point<Patient>> points, std::span<FieldSample> samples) const;
  /// The definition: seven evaluations of 125 voxels, with coefficients interpolated linearly in a table over
  /// d^2 (steps of 1/256 voxel^2; relative error below 1e-5 at the smallest sigma).
  FieldSample sample_literal(const Point<Patient>& x) const;

  const LabelVoxels& voxels() const { return voxels_; }
  double sigma_voxels() const { return sigma_voxels_; }

 private:
  GaussianSphere(LabelVoxels voxels, double sigma_voxels);

  LabelVoxels voxels_;
  double sigma_voxels_;
  std::vector<double> over_squared_distance_;
  std::vector<float> over_fraction_;
};

/// The smooth sphere, developed for palpate: the raw labels filtered by a kernel that is twice continuously
/// differentiable and reaches zero, with zero slope and curvature, inside its window:
///
///   f(x) = sum over voxels of  w_i(x) w_j(y) w_k(z) L(i, j, k)
///   w_i(x) = t((i - x) / r) / sum over n of t((n - x) / r)
///
/// where t(u) = (1 - u^2)^3 for |u| < 1 and 0 elsewhere, separable along the grid axes with a radius R in mm
/// (r = R over the spacing). Each axis is normalised by its own sum, so the weights sum to 1 everywhere; the
/// gradient is the exact derivative of that quotient, from the same pass over the voxels.
///
/// R = 3 sigma gives t the second moment sigma^2 of a Gaussian. The maximum slope of a flat surface across a
/// grid axis is then 35/(96 sigma) = 0.365/sigma per mm, compared with 0.399/sigma of a Gaussian, so the rule
/// sigma >= F_full/(K_stable sqrt(2 pi)) holds with margin. No kernel over fewer than four voxels is smooth:
/// along an axis where 3 sigma is less than two voxels the radius is two voxels.
///
/// If all voxels in the window are equal, the value is exactly 0 or 1 and the gradient exactly 0.
class SmoothSphere {
 public:
  static constexpr double kRadiusPerSigma = 3;
  static constexpr double kMinRadiusVoxels = 2, kMaxRadiusVoxels = 64;

  /// Errors: kBadInput if sigma_mm is not above 0, or the radius exceeds 64 voxels along an axis.
  static Result<SmoothSphere> make(LabelVoxels voxels, double sigma_mm);

  /// Value and gradient.
  FieldSample sample(const Point<Patient>& x) const;
  /// Batch version; `samples` and `points` have the same size.
  void sample(std::span<const Point<Patient>> points, std::span<FieldSample> samples) const;
  /// The definition, in double. Within 1e-5 of `sample` for the value, 1e-5 per voxel for the gradient.
  FieldSample sample_literal(const Point<Patient>& x) const;

  const LabelVoxels& voxels() const { return voxels_; }
  /// Kernel radius along i, j, k, in voxels.
  const std::array<double, 3>& radius_voxels() const { return radius_voxels_; }
  /// Standard deviation of a Gaussian with the kernel's second moment, along its narrowest axis; mm.
  double min_sigma_mm() const;

 private:
  SmoothSphere(LabelVoxels voxels, const std::array<double, 3>& radius_voxels);

  LabelVoxels voxels_;
  std::array<double, 3> radius_voxels_;
  std::array<int, 3> count_{};  ///< Window size in voxels along each axis
};

}  // namespace palpate
