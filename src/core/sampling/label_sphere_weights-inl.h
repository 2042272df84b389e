// Kernel weights of the two sphere filters along each axis, for label_sphere_simd.cc. Included once per
// target.
#include "sampling/label_sphere_simd.h"

#if defined(PALPATE_SAMPLING_LABEL_SPHERE_WEIGHTS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef PALPATE_SAMPLING_LABEL_SPHERE_WEIGHTS_INL_H_
#undef PALPATE_SAMPLING_LABEL_SPHERE_WEIGHTS_INL_H_
#else
#define PALPATE_SAMPLING_LABEL_SPHERE_WEIGHTS_INL_H_
#endif

#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace palpate::internal::label_sphere::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

constexpr int kMaxCount = 2 * 64;

/// Weights and slopes along one axis for the voxels from `start` on, before normalisation:
///     w_i = weight_i * per_sum,   dw_i/dx = (slope_i * slope_unit - weight_i * drift) * per_sum
struct alignas(64) AxisWeights {
  float weight[kMaxCount];  ///< padded with 0 beyond `count` to whole vectors
  float slope[kMaxCount];
  int start, count;
  double per_sum, slope_unit, drift;
  double total;  ///< sum of w
};

/// 0, 1, 2, ... for vector loads.
struct alignas(64) WholeNumbers {
  constexpr WholeNumbers() : value() {
    for (int n = 0; n < kMaxCount; ++n) value[n] = static_cast<float>(n);
  }
  float value[kMaxCount];
};
constexpr WholeNumbers kWholeNumbers;

HWY_INLINE double floor(double x) {
  const hn::CappedTag<double, 1> d;
  return hn::GetLane(hn::Floor(hn::Set(d, x)));
}
HWY_INLINE double nearest(double x) {
  return floor(x + 0.5);
}

/// Padded row length: vectors of 16 lanes, and a last one of 4 or 8 where that suffices.
HWY_INLINE int padded(int count) {
  const int remaining = count & 15;
  return (count & ~15) + (remaining == 0 ? 0 : remaining <= 4 ? 4 : remaining <= 8 ? 8 : 16);
}

/// The window size: kCount if it is a compile-time constant, or `count` if kCount is 0.
template <int kCount>
HWY_INLINE int count_or(int count) {
  return kCount > 0 ? kCount : count;
}

/// Sum of four partial sums, p aligned to 16 bytes.
HWY_INLINE float sum_of_four(const float* p) {
  return (p[0] + p[1]) + (p[2] + p[3]);
}

/// Weights t(u) and slopes u (1-u^2)^2, where t' = 6/r times that. By the quotient rule (t/S)' = t'/S - t
/// S'/S^2.
HWY_INLINE void smooth_axis(double x, double radius, float per_radius, int count, AxisWeights& axis) {
  const hn::CappedTag<float, 4> d;
  const int lanes = static_cast<int>(hn::Lanes(d)), length = padded(count);
  const double start = floor(x - radius) + 1;
  axis.start = static_cast<int>(start);
  axis.count = count;

  const auto zero = hn::Zero(d), one = hn::Set(d, 1.0f);
  const auto offset = hn::Set(d, static_cast<float>(start - x));
  const auto unit = hn::Set(d, per_radius);
  alignas(16) float weight_sums[4], slope_sums[4];
  for (int lane = 0; lane < 4; lane += lanes) {
    auto weight_sum = zero, slope_sum = zero;
    for (int i = lane; i < length; i += 4) {
      const auto u = hn::Mul(hn::Add(hn::Load(d, kWholeNumbers.value + i), offset), unit);
      const auto t = hn::Max(zero, hn::Sub(one, hn::Mul(u, u)));
      const auto t2 = hn::Mul(t, t);
      const auto weight = hn::Mul(t2, t), slope = hn::Mul(t2, u);
      hn::Store(weight, d, axis.weight + i);
      hn::Store(slope, d, axis.slope + i);
      weight_sum = hn::Add(weight_sum, weight);
      slope_sum = hn::Add(slope_sum, slope);
    }
    hn::Store(weight_sum, d, weight_sums + lane);
    hn::Store(slope_sum, d, slope_sums + lane);
  }
  axis.per_sum = 1 / static_cast<double>(sum_of_four(weight_sums));
  axis.slope_unit = 6 * static_cast<double>(per_radius);
  axis.drift = sum_of_four(slope_sums) * axis.slope_unit * axis.per_sum;
  axis.total = 1;
}

/// Values one voxel away use the same weights in a window shifted by one voxel, so over the seven voxels of
/// both windows their difference has the weights e(i-1) - e(i+1).
HWY_INLINE void gaussian_axis(double x, const GaussianTable& table, AxisWeights& axis) {
  const hn::CappedTag<float, 4> d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const double centre = nearest(x);
  axis.start = static_cast<int>(centre) - 3;
  axis.count = 7;

  const double table_position = (x - centre + 0.5) * GaussianTable::kIntervals;
  const int last = GaussianTable::kIntervals - 1;
  const int interval = static_cast<int>(table_position) < last ? static_cast<int>(table_position) : last;
  const float* row = table.rows + interval * GaussianTable::kStride;
  const auto fraction = hn::Set(d, static_cast<float>(table_position - interval));
  const auto half = hn::Set(d, 0.5f);
  alignas(16) float sums[4];
  for (int lane = 0; lane < 4; lane += lanes) {
    auto sum = hn::Zero(d);
    for (int i = lane; i < 8; i += 4) {
      const auto interpolate = [&](const float* at) HWY_ATTR {
        const auto a = hn::LoadU(d, at), b = hn::LoadU(d, at + GaussianTable::kStride);
        return hn::Add(a, hn::Mul(fraction, hn::Sub(b, a)));
      };
      const auto weight = interpolate(row + i + 1);
      hn::Store(weight, d, axis.weight + i);
      hn::Store(hn::Mul(half, hn::Sub(interpolate(row + i), interpolate(row + i + 2))), d, axis.slope + i);
      sum = hn::Add(sum, weight);
    }
    hn::Store(sum, d, sums + lane);
  }
  axis.per_sum = axis.slope_unit = 1;
  axis.drift = 0;
  axis.total = sum_of_four(sums);
}

HWY_INLINE void weigh(const SpherePoint& p, const SmoothKernel& kernel, AxisWeights (&axes)[3]) {
  const auto weigh_axis = [&](int a) HWY_ATTR {
    smooth_axis(p.x[a], kernel.radius[a], kernel.per_radius[a], kernel.count[a], axes[a]);
  };
  weigh_axis(0);
  weigh_axis(1);
  weigh_axis(2);
}
HWY_INLINE void weigh(const SpherePoint& p, const GaussianTable& table, AxisWeights (&axes)[3]) {
  gaussian_axis(p.x[0], table, axes[0]);
  gaussian_axis(p.x[1], table, axes[1]);
  gaussian_axis(p.x[2], table, axes[2]);
}
HWY_INLINE double reach(const SmoothKernel& kernel, int a) {
  return kernel.radius[a];
}
HWY_INLINE double reach(const GaussianTable&, int) {
  return 4;
}

}  // namespace palpate::internal::label_sphere::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // per target
