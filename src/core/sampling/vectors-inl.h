// Vectors of four doubles on every SIMD target, and the steps shared by all methods: from a point to its
// cell, and from the interpolated numbers to a sample. Included once per target, after hwy/foreach_target.h;
// see label_sphere_simd.cc for the restrictions on code in a target's namespace.
//
// Four doubles are one vector of AVX2, two of SSE, or four "vectors" of the scalar target. Operations on them
// have the same sequence of roundings on each.

#include <hwy/highway.h>

#include <cstddef>
#include <cstdint>

#include "palpate/sampling/sampling.h"

#if defined(PALPATE_SAMPLING_VECTORS_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef PALPATE_SAMPLING_VECTORS_INL
#undef PALPATE_SAMPLING_VECTORS_INL
#else
#define PALPATE_SAMPLING_VECTORS_INL
#endif

HWY_BEFORE_NAMESPACE();
namespace palpate::internal::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

using D4 = hn::CappedTag<double, 4>;
constexpr int kLanesOfQuad = static_cast<int>(hn::MaxLanes(D4()));
constexpr int kPartsOfQuad = 4 / kLanesOfQuad;

/// Four doubles.
struct Quad {
  hn::Vec<D4> part[kPartsOfQuad];
};

template <class Op>
HWY_INLINE Quad each_part(const Op& op) {
  Quad result;
  for (int n = 0; n < kPartsOfQuad; ++n) result.part[n] = op(n);
  return result;
}
HWY_INLINE Quad operator+(const Quad& a, const Quad& b) {
  return each_part([&](int n) HWY_ATTR { return hn::Add(a.part[n], b.part[n]); });
}
HWY_INLINE Quad operator-(const Quad& a, const Quad& b) {
  return each_part([&](int n) HWY_ATTR { return hn::Sub(a.part[n], b.part[n]); });
}
HWY_INLINE Quad operator*(const Quad& a, const Quad& b) {
  return each_part([&](int n) HWY_ATTR { return hn::Mul(a.part[n], b.part[n]); });
}
HWY_INLINE Quad operator/(const Quad& a, const Quad& b) {
  return each_part([&](int n) HWY_ATTR { return hn::Div(a.part[n], b.part[n]); });
}
HWY_INLINE Quad all_four(double x) {
  return each_part([&](int) HWY_ATTR { return hn::Set(D4(), x); });
}
HWY_INLINE Quad load_four(const double* p) {
  return each_part([&](int n) HWY_ATTR { return hn::LoadU(D4(), p + n * kLanesOfQuad); });
}
HWY_INLINE void store_four(const Quad& a, double* p) {
  for (int n = 0; n < kPartsOfQuad; ++n) hn::StoreU(a.part[n], D4(), p + n * kLanesOfQuad);
}

#if HWY_TARGET == HWY_SCALAR
HWY_INLINE Quad of_four(double a, double b, double c, double d) {
  return {{hn::Set(D4(), a), hn::Set(D4(), b), hn::Set(D4(), c), hn::Set(D4(), d)}};
}
template <int kLane>
HWY_INLINE double lane(const Quad& a) {
  return hn::GetLane(a.part[kLane]);
}
#else
template <class V>
HWY_INLINE auto quad_of(V lower, V upper) {
  if constexpr (kPartsOfQuad == 2) {
    return Quad{{lower, upper}};
  } else {
    return Quad{{hn::Combine(D4(), upper, lower)}};
  }
}
/// Built without a round trip through memory, where a vector load would stall on four scalar stores.
HWY_INLINE Quad of_four(double a, double b, double c, double d) {
  const hn::FixedTag<double, 2> two;
  const auto lower = hn::InterleaveLower(two, hn::Set(two, a), hn::Set(two, b));
  const auto upper = hn::InterleaveLower(two, hn::Set(two, c), hn::Set(two, d));
  return quad_of(lower, upper);
}
/// Lanes 0 and 1, or 2 and 3. A template, because only one of its branches compiles on a target.
template <int kHalf, class AnyQuad>
HWY_INLINE auto half_of(const AnyQuad& a) {
  if constexpr (kPartsOfQuad == 2) {
    return a.part[kHalf];
  } else {
    const hn::Half<D4> d;
    if constexpr (kHalf == 0) {
      return hn::LowerHalf(d, a.part[0]);
    } else {
      return hn::UpperHalf(d, a.part[0]);
    }
  }
}
template <int kLane>
HWY_INLINE double lane(const Quad& a) {
  const auto half = half_of<kLane / 2>(a);
  return hn::GetLane(kLane % 2 == 0 ? half : hn::DupOdd(half));
}
#endif

/// Whether all four lanes of x are strictly between those of low and high; false if x is NaN.
HWY_INLINE bool between(const Quad& low, const Quad& x, const Quad& high) {
  bool all = true;
  for (int n = 0; n < kPartsOfQuad; ++n) {
    all &= hn::AllTrue(D4(), hn::And(hn::Gt(x.part[n], low.part[n]), hn::Lt(x.part[n], high.part[n])));
  }
  return all;
}

/// Cell that contains a point: floor of its voxel coordinates, and the fraction 0 ... 1 beyond it.
struct Cell {
  std::ptrdiff_t i, j, k;
  double u, v, w;
};

HWY_INLINE Quad to_voxels(const SamplingMap& map, const double* x) {
  const auto& c = map.voxel_columns;
  return (load_four(c[0]) * all_four(x[0]) + load_four(c[1]) * all_four(x[1])) +
         (load_four(c[2]) * all_four(x[2]) + load_four(c[3]));
}

/// Adding 1.5 * 2^52 rounds to the nearest integer and leaves it in the low bits of the mantissa: a floor
/// without conversion or comparison. For an integer x = n the result may be n - 1 with fraction 1, which is
/// the same point.
HWY_INLINE Cell cell_of(const Quad& x) {
  const Quad magic = all_four(6755399441055744.0);
  const Quad shifted = (x - all_four(0.5)) + magic;
  const Quad fraction = x - (shifted - magic);
  const auto index = [](double number) HWY_ATTR {
    std::int64_t bits;
    hwy::CopyBytes<sizeof(bits)>(&number, &bits);
    return static_cast<std::ptrdiff_t>(static_cast<std::int32_t>(bits));
  };
  return {index(lane<0>(shifted)), index(lane<1>(shifted)), index(lane<2>(shifted)),
          lane<0>(fraction),       lane<1>(fraction),       lane<2>(fraction)};
}

/// A sample is written as four doubles: value, gradient x, y, z.
static_assert(sizeof(FieldSample) == 4 * sizeof(double));
static_assert(sizeof(Point<Patient>) == 3 * sizeof(double));

HWY_INLINE void write_outside(const SamplingMap& map, double* sample) {
  sample[0] = map.outside;
  sample[1] = sample[2] = sample[3] = 0;
}

/// Maps a stored number and its derivatives per voxel to a sample.
HWY_INLINE void write_sample(const SamplingMap& map, double stored, double gi, double gj, double gk,
                             double* sample) {
  const auto& c = map.sample_columns;
  store_four((load_four(c[0]) * all_four(gi) + load_four(c[1]) * all_four(gj)) +
                 (load_four(c[2]) * all_four(gk) + (load_four(c[3]) * all_four(stored) + load_four(c[4]))),
             sample);
}

}  // namespace palpate::internal::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
