// Sixteen floats on every SIMD target: the four rows of four voxels of one plane of a point's 4 x 4 x 4
// neighbourhood. One vector of AVX-512, two of AVX2, four of SSE. Lane a + 4 b is voxel a of row b. The
// summation order is the same on every target: over b as (0 + 2) + (1 + 3), over a likewise. Included once
// per target, after hwy/foreach_target.h.

#include <hwy/highway.h>

#include <cstddef>
#include <cstdint>

#include "sampling/vectors-inl.h"

#if defined(PALPATE_SAMPLING_FOUR_ROWS_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef PALPATE_SAMPLING_FOUR_ROWS_INL
#undef PALPATE_SAMPLING_FOUR_ROWS_INL
#else
#define PALPATE_SAMPLING_FOUR_ROWS_INL
#endif

HWY_BEFORE_NAMESPACE();
namespace palpate::internal::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

#if HWY_TARGET == HWY_SCALAR

/// Four floats.
struct Float4 {
  float lane[4];
};
template <class Op>
HWY_INLINE Float4 each_lane(const Op& op) {
  return {{op(0), op(1), op(2), op(3)}};
}
HWY_INLINE Float4 operator+(const Float4& a, const Float4& b) {
  return each_lane([&](int n) HWY_ATTR { return a.lane[n] + b.lane[n]; });
}
HWY_INLINE Float4 operator*(const Float4& a, const Float4& b) {
  return each_lane([&](int n) HWY_ATTR { return a.lane[n] * b.lane[n]; });
}
HWY_INLINE Float4 load4(const float* p) {
  return {{p[0], p[1], p[2], p[3]}};
}
HWY_INLINE Float4 all4(float x) {
  return {{x, x, x, x}};
}
template <int kLane>
HWY_INLINE float lane_of(const Float4& a) {
  return a.lane[kLane];
}

constexpr int kRowsOfPart = 1;
using Part = Float4;
template <class T>
HWY_INLINE Part load_rows(const T* p, std::ptrdiff_t) {
  return each_lane([&](int n) HWY_ATTR { return static_cast<float>(p[n]); });
}
HWY_INLINE Part spread(const Float4& a, int first) {
  return all4(a.lane[first]);
}
HWY_INLINE Part repeated(const Float4& a) {
  return a;
}
HWY_INLINE Part all_rows(float x) {
  return all4(x);
}
HWY_INLINE Float4 folded(const Part& part) {
  return part;
}
/// Horizontal sums of four vectors of four lanes, (0 + 2) + (1 + 3).
HWY_INLINE Float4 add_up(const Float4& a, const Float4& b, const Float4& c, const Float4& d) {
  const auto sum = [](const Float4& x) HWY_ATTR { return (x.lane[0] + x.lane[2]) + (x.lane[1] + x.lane[3]); };
  return {{sum(a), sum(b), sum(c), sum(d)}};
}
HWY_INLINE Quad to_doubles(const Float4& a) {
  return each_part([&](int n) HWY_ATTR { return hn::Set(D4(), static_cast<double>(a.lane[n])); });
}

#else

/// One vector of floats.
template <class D>
struct Floats {
  hn::Vec<D> v;
};
template <class D>
HWY_INLINE Floats<D> operator+(const Floats<D>& a, const Floats<D>& b) {
  return {hn::Add(a.v, b.v)};
}
template <class D>
HWY_INLINE Floats<D> operator*(const Floats<D>& a, const Floats<D>& b) {
  return {hn::Mul(a.v, b.v)};
}

/// Four floats.
using DF4 = hn::FixedTag<float, 4>;
using Float4 = Floats<DF4>;
HWY_INLINE Float4 load4(const float* p) {
  return {hn::LoadU(DF4(), p)};
}
HWY_INLINE Float4 all4(float x) {
  return {hn::Set(DF4(), x)};
}
template <int kLane>
HWY_INLINE float lane_of(const Float4& a) {
  return hn::GetLane(hn::Broadcast<kLane>(a.v));
}

/// As many rows as fit into a vector, at most the four of one plane.
using DPart = hn::CappedTag<float, 16>;
constexpr int kRowsOfPart = static_cast<int>(hn::MaxLanes(DPart())) / 4;
using Part = Floats<DPart>;

/// Concatenates rows of four.
template <int kRows, class RowAt>
HWY_INLINE auto joined(const RowAt& row_at) {
  if constexpr (kRows == 1) {
    return row_at(0);
  } else {
    const auto lower = joined<kRows / 2>(row_at);
    const auto upper = joined<kRows / 2>([&](int n) HWY_ATTR { return row_at(n + kRows / 2); });
    return hn::Combine(hn::Twice<hn::DFromV<decltype(lower)> >(), upper, lower);
  }
}
HWY_INLINE Part load_rows(const float* p, std::ptrdiff_t row) {
  return {joined<kRowsOfPart>([&](int n) HWY_ATTR { return hn::LoadU(DF4(), p + n * row); })};
}
HWY_INLINE Part load_rows(const std::int16_t* p, std::ptrdiff_t row) {
  const hn::FixedTag<std::int16_t, 4> d;
  const auto stored = joined<kRowsOfPart>([&](int n) HWY_ATTR { return hn::LoadU(d, p + n * row); });
  return {hn::ConvertTo(DPart(), hn::PromoteTo(hn::Rebind<std::int32_t, DPart>(), stored))};
}
/// Permutes the lanes of `a` into a part. A template, because only one of its branches compiles on a target.
template <class AnyFloat4>
HWY_INLINE Part picked(const AnyFloat4& a, const std::int32_t* lanes) {
  if constexpr (kRowsOfPart == 4) {
    const hn::Half<DPart> half;
    return {hn::TableLookupLanes(hn::ZeroExtendVector(DPart(), hn::ZeroExtendVector(half, a.v)),
                                 hn::SetTableIndices(DPart(), lanes))};
  } else {
    return {hn::TableLookupLanes(hn::ZeroExtendVector(DPart(), a.v), hn::SetTableIndices(DPart(), lanes))};
  }
}
/// Repeats lane `first` four times, then the next lane, for every row of a part.
template <class AnyFloat4>
HWY_INLINE Part spread(const AnyFloat4& a, int first) {
  if constexpr (kRowsOfPart == 1) {
    const decltype(a.v) lanes[4] = {hn::Broadcast<0>(a.v), hn::Broadcast<1>(a.v), hn::Broadcast<2>(a.v),
                                    hn::Broadcast<3>(a.v)};
    return {lanes[first]};
  } else {
    HWY_ALIGN static constexpr std::int32_t kLanes[16] = {0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3};
    return picked(a, kLanes + 4 * first);
  }
}
template <class AnyFloat4>
HWY_INLINE Part repeated(const AnyFloat4& a) {
  if constexpr (kRowsOfPart == 1) {
    return {a.v};
  } else {
    HWY_ALIGN static constexpr std::int32_t kLanes[16] = {0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3};
    return picked(a, kLanes);
  }
}
HWY_INLINE Part all_rows(float x) {
  return {hn::Set(DPart(), x)};
}
/// Sum of the rows of a part, adding the upper half to the lower.
template <class D>
HWY_INLINE Float4 folded(const Floats<D>& part) {
  if constexpr (hn::MaxLanes(D()) == 4) {
    return {part.v};
  } else {
    using Lower = hn::Half<D>;
    return folded(Floats<Lower>{hn::Add(hn::LowerHalf(Lower(), part.v), hn::UpperHalf(Lower(), part.v))});
  }
}
/// Horizontal sums of four vectors of four lanes, (0 + 2) + (1 + 3).
HWY_INLINE Float4 add_up(const Float4& a, const Float4& b, const Float4& c, const Float4& d) {
  const DF4 f;
  const auto ab = hn::Add(hn::InterleaveLower(f, a.v, b.v), hn::InterleaveUpper(f, a.v, b.v));
  const auto cd = hn::Add(hn::InterleaveLower(f, c.v, d.v), hn::InterleaveUpper(f, c.v, d.v));
  return {hn::Add(hn::ConcatLowerLower(f, cd, ab), hn::ConcatUpperUpper(f, cd, ab))};
}
template <class AnyFloat4>
HWY_INLINE Quad to_doubles(const AnyFloat4& a) {
  if constexpr (kPartsOfQuad == 1) {
    return {{hn::PromoteTo(D4(), a.v)}};
  } else {
    const hn::Half<DF4> half;
    return {{hn::PromoteTo(D4(), hn::LowerHalf(half, a.v)), hn::PromoteTo(D4(), hn::UpperHalf(half, a.v))}};
  }
}

#endif

constexpr int kParts = 4 / kRowsOfPart;

/// Sum of all parts, in the order (0 + 2) + (1 + 3) of their rows.
HWY_INLINE Float4 add_rows(const Part (&part)[kParts]) {
  if constexpr (kParts == 1) {
    return folded(part[0]);
  } else if constexpr (kParts == 2) {
    return folded(part[0] + part[kParts / 2]);
  } else {
    return folded((part[0] + part[2 % kParts]) + (part[1] + part[3 % kParts]));
  }
}

/// Weights p along i, j and k, and their derivatives q.
struct WeightsOf64 {
  Float4 p_i, q_i, p_j, q_j, p_k, q_k;
};

/// Separable weighted sums over 4 x 4 x 4 numbers. `plane_rows(b, e)` returns the rows from b on of plane e,
/// or anything that multiplies with a part. With V = sum_e rows p_e and K = sum_e rows q_e, the result is
///     (p_a p_b) V,  (q_a p_b) V,  (p_a q_b) V,  (p_a p_b) K
/// Sums over e are formed as (0 + 1) + (2 + 3).
template <class PlaneRows>
HWY_INLINE Float4 sum_64(const PlaneRows& plane_rows, const WeightsOf64& weights) {
  const auto along_k = [](const auto(&S)[4], const Float4& weight) HWY_ATTR {
    return (S[0] * all_rows(lane_of<0>(weight)) + S[1] * all_rows(lane_of<1>(weight))) +
           (S[2] * all_rows(lane_of<2>(weight)) + S[3] * all_rows(lane_of<3>(weight)));
  };
  const Part p_i = repeated(weights.p_i), q_i = repeated(weights.q_i);
  Part f[kParts], gi[kParts], gj[kParts], gk[kParts];
  for (int n = 0; n < kParts; ++n) {
    const int b = n * kRowsOfPart;
    const decltype(plane_rows(0, 0)) S[4] = {plane_rows(b, 0), plane_rows(b, 1), plane_rows(b, 2),
                                             plane_rows(b, 3)};
    const Part V = along_k(S, weights.p_k), K = along_k(S, weights.q_k);
    const Part p_j = spread(weights.p_j, b);
    const Part p_ij = p_i * p_j;
    f[n] = p_ij * V;
    gi[n] = (q_i * p_j) * V;
    gj[n] = (p_i * spread(weights.q_j, b)) * V;
    gk[n] = p_ij * K;
  }
  return add_up(add_rows(f), add_rows(gi), add_rows(gj), add_rows(gk));
}

}  // namespace palpate::internal::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
