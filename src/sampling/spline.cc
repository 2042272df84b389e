#include "palpate/sampling.h"

// The spline at a point of fraction (u, v, w) in its cell is a sum over 4 x 4 x 4 coefficients c_abe, a along
// i, b along j, e along k, of products of weights
//
//     f   = sum c  p_a(u) p_b(v) p_e(w)       p(t) = ((1-t)^3, 3t^3 - 6t^2 + 4, -3t^3 + 3t^2 + 3t + 1, t^3) /
//     6 g_i = sum c  q_a(u) p_b(v) p_e(w)       q(t) = p'(t), and so on for g_j and g_k
//
// The sixteen (a, b) of one e are one vector, a fastest: S_e. Along k first,
//
//     V = sum_e p_e(w) S_e,   K = sum_e q_e(w) S_e
//
// then f = (p_a p_b) V, g_i = (q_a p_b) V, g_j = (p_a q_b) V, g_k = (p_a p_b) K. Sixteen floats are one
// vector of AVX-512, two of AVX2, four of SSE; sums are formed in the same order on each: over e as (0 + 1) +
// (2 + 3), over b as (0 + 2) + (1 + 3), over a alike.

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "sampling/spline.cc"
#include <hwy/foreach_target.h>
// after foreach_target.h
#include <hwy/highway.h>

#include "sampling/vectors-inl.h"

HWY_BEFORE_NAMESPACE();
namespace palpate::internal::HWY_NAMESPACE {

// p and q as polynomials in t, one row a power
HWY_ALIGN constexpr float kWeight[4][4] = {{1 / 6.0f, 4 / 6.0f, 1 / 6.0f, 0},
                                           {-0.5f, 0, 0.5f, 0},
                                           {0.5f, -1, 0.5f, 0},
                                           {-1 / 6.0f, 0.5f, -0.5f, 1 / 6.0f}};
HWY_ALIGN constexpr float kSlope[3][4] = {{-0.5f, 0, 0.5f, 0}, {1, -2, 1, 0}, {-0.5f, 1.5f, -1.5f, 0.5f}};

#if HWY_TARGET == HWY_SCALAR

/// Four floats; a row of coefficients.
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
HWY_INLINE void add_up(const Float4& a, const Float4& b, const Float4& c, const Float4& d, double* sums) {
  const auto sum = [](const Float4& x) HWY_ATTR { return (x.lane[0] + x.lane[2]) + (x.lane[1] + x.lane[3]); };
  sums[0] = sum(a), sums[1] = sum(b), sums[2] = sum(c), sums[3] = sum(d);
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

/// A row of coefficients.
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

/// As many rows as a vector holds, at most the four of one e.
using DPart = hn::CappedTag<float, 16>;
constexpr int kRowsOfPart = static_cast<int>(hn::MaxLanes(DPart())) / 4;
using Part = Floats<DPart>;

/// Rows of four joined two by two.
template <int kRows, class RowAt>
HWY_INLINE auto joined(const RowAt& row_at) {
  if constexpr (kRows == 1) {
    return row_at(0);
  } else {
    const auto lower = joined<kRows / 2>(row_at);
    const auto upper = joined<kRows / 2>([&](int n) HWY_ATTR { return row_at(n + kRows / 2); });
    return hn::Combine(hn::Twice<hn::DFromV<decltype(lower)>>(), upper, lower);
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
/// Lane `first` four times, then the next lane four times, for as many rows as a part has.
HWY_INLINE Part spread(const Float4& a, int first) {
  const hn::Vec<DF4> lanes[4] = {hn::Broadcast<0>(a.v), hn::Broadcast<1>(a.v), hn::Broadcast<2>(a.v),
                                 hn::Broadcast<3>(a.v)};
  return {joined<kRowsOfPart>([&](int n) HWY_ATTR { return lanes[first + n]; })};
}
HWY_INLINE Part repeated(const Float4& a) {
  return {joined<kRowsOfPart>([&](int) HWY_ATTR { return a.v; })};
}
HWY_INLINE Part all_rows(float x) {
  return {hn::Set(DPart(), x)};
}
/// The rows of a part added up, the upper half to the lower.
template <class D>
HWY_INLINE Float4 folded(const Floats<D>& part) {
  if constexpr (hn::MaxLanes(D()) == 4) {
    return {part.v};
  } else {
    using Lower = hn::Half<D>;
    return folded(Floats<Lower>{hn::Add(hn::LowerHalf(Lower(), part.v), hn::UpperHalf(Lower(), part.v))});
  }
}
HWY_INLINE void add_up(const Float4& a, const Float4& b, const Float4& c, const Float4& d, double* sums) {
  const DF4 f;
  const auto ab = hn::Add(hn::InterleaveLower(f, a.v, b.v), hn::InterleaveUpper(f, a.v, b.v));
  const auto cd = hn::Add(hn::InterleaveLower(f, c.v, d.v), hn::InterleaveUpper(f, c.v, d.v));
  const Float4 all{hn::Add(hn::ConcatLowerLower(f, cd, ab), hn::ConcatUpperUpper(f, cd, ab))};
  sums[0] = lane_of<0>(all), sums[1] = lane_of<1>(all), sums[2] = lane_of<2>(all), sums[3] = lane_of<3>(all);
}

#endif

constexpr int kParts = 4 / kRowsOfPart;

/// All parts added up, (0 + 2) + (1 + 3) for their rows.
HWY_INLINE Float4 add_rows(const Part (&part)[kParts]) {
  if constexpr (kParts == 1) {
    return folded(part[0]);
  } else if constexpr (kParts == 2) {
    return folded(part[0] + part[kParts / 2]);
  } else {
    return folded((part[0] + part[2 % kParts]) + (part[1] + part[3 % kParts]));
  }
}

HWY_INLINE Float4 weights(float t) {
  const Float4 x = all4(t);
  return ((load4(kWeight[3]) * x + load4(kWeight[2])) * x + load4(kWeight[1])) * x + load4(kWeight[0]);
}
HWY_INLINE Float4 slopes(float t) {
  const Float4 x = all4(t);
  return (load4(kSlope[2]) * x + load4(kSlope[1])) * x + load4(kSlope[0]);
}

template <class T>
HWY_INLINE void sample_one(const VoxelView<T>& coefficients, const SamplingMap& map, const double* point,
                           double* sample) {
  const Quad x = to_voxels(map, point);
  if (!between(load_four(map.low), x, load_four(map.high))) return write_outside(map, sample);
  const Cell c = cell_of(x);
  const std::ptrdiff_t row = coefficients.row, slice = coefficients.slice;
  const T* const first = coefficients.origin + (c.i - 1) + (c.j - 1) * row + (c.k - 1) * slice;

  const auto u = static_cast<float>(c.u), v = static_cast<float>(c.v), w = static_cast<float>(c.w);
  const Part p_i = repeated(weights(u)), q_i = repeated(slopes(u));
  const Float4 p_j = weights(v), q_j = slopes(v), p_k = weights(w), q_k = slopes(w);
  const auto along_k = [](const Part(&S)[4], const Float4& weight) HWY_ATTR {
    return (S[0] * all_rows(lane_of<0>(weight)) + S[1] * all_rows(lane_of<1>(weight))) +
           (S[2] * all_rows(lane_of<2>(weight)) + S[3] * all_rows(lane_of<3>(weight)));
  };

  Part f[kParts], gi[kParts], gj[kParts], gk[kParts];
  for (int n = 0; n < kParts; ++n) {
    const int b = n * kRowsOfPart;
    const T* const rows = first + b * row;
    const Part S[4] = {load_rows(rows, row), load_rows(rows + slice, row), load_rows(rows + 2 * slice, row),
                       load_rows(rows + 3 * slice, row)};
    const Part V = along_k(S, p_k), K = along_k(S, q_k);
    const Part p_ij = p_i * spread(p_j, b);
    f[n] = p_ij * V;
    gi[n] = (q_i * spread(p_j, b)) * V;
    gj[n] = (p_i * spread(q_j, b)) * V;
    gk[n] = p_ij * K;
  }
  double sums[4];
  add_up(add_rows(f), add_rows(gi), add_rows(gj), add_rows(gk), sums);
  write_sample(map, sums[0], sums[1], sums[2], sums[3], sample);
}

void spline_i16(const VoxelView<std::int16_t>& coefficients, const SamplingMap& map, const double* points,
                std::size_t count, double* samples) {
  for (; count > 0; --count, points += 3, samples += 4) sample_one(coefficients, map, points, samples);
}
void spline_float(const VoxelView<float>& coefficients, const SamplingMap& map, const double* points,
                  std::size_t count, double* samples) {
  for (; count > 0; --count, points += 3, samples += 4) sample_one(coefficients, map, points, samples);
}

}  // namespace palpate::internal::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace palpate {

namespace internal {

HWY_EXPORT(spline_i16);
HWY_EXPORT(spline_float);

}  // namespace internal

// many points are one after the other: sixteen rows of four fill the vectors already, where gathers would
// fetch every coefficient of every point by itself
void sample_spline(const SplineField& field, std::span<const Point<Patient>> points,
                   std::span<FieldSample> samples) {
  PALPATE_CHECK(points.size() == samples.size());
  if (points.empty()) return;
  const double* const first = points.front().eigen().data();
  double* const out = &samples.front().value;
  if (const auto* steps = std::get_if<PaddedVolume<std::int16_t>>(&field.coefficients())) {
    HWY_DYNAMIC_DISPATCH(internal::spline_i16)(steps->view(), field.map(), first, points.size(), out);
  } else {
    const auto& floats = *std::get_if<PaddedVolume<float>>(&field.coefficients());
    HWY_DYNAMIC_DISPATCH(internal::spline_float)(floats.view(), field.map(), first, points.size(), out);
  }
}

FieldSample sample_spline(const SplineField& field, const Point<Patient>& x) {
  FieldSample sample;
  sample_spline(field, {&x, 1}, {&sample, 1});
  return sample;
}

}  // namespace palpate
#endif  // HWY_ONCE
