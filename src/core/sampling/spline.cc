#include "palpate/sampling/sampling.h"

// The spline at a point with fraction (u, v, w) in its cell is a sum over 4 x 4 x 4 coefficients c_abe, a
// along i, b along j, e along k, of products of weights:
//
//     f   = sum c  p_a(u) p_b(v) p_e(w)
//     g_i = sum c  q_a(u) p_b(v) p_e(w)       and likewise g_j and g_k
//
// with p(t) = ((1-t)^3, 3t^3 - 6t^2 + 4, -3t^3 + 3t^2 + 3t + 1, t^3) / 6 and q(t) = p'(t).
//
// The sixteen (a, b) of one e form the vector S_e, a fastest. Summing along k first,
//
//     V = sum_e p_e(w) S_e,   K = sum_e q_e(w) S_e
//
// f = (p_a p_b) V, g_i = (q_a p_b) V, g_j = (p_a q_b) V, g_k = (p_a p_b) K. Sixteen floats are one vector of
// AVX-512, two of AVX2, four of SSE; the summation order is the same on each: over e as (0 + 1) + (2 + 3),
// over b as (0 + 2) + (1 + 3), over a likewise.

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "sampling/spline.cc"
#include <hwy/foreach_target.h>
// after foreach_target.h
#include <hwy/highway.h>

#include "sampling/four_rows-inl.h"
#include "sampling/vectors-inl.h"

HWY_BEFORE_NAMESPACE();
namespace palpate::internal::HWY_NAMESPACE {

// p and q as polynomials in t, one row per power
HWY_ALIGN constexpr float kWeight[4][4] = {{1 / 6.0f, 4 / 6.0f, 1 / 6.0f, 0},
                                           {-0.5f, 0, 0.5f, 0},
                                           {0.5f, -1, 0.5f, 0},
                                           {-1 / 6.0f, 0.5f, -0.5f, 1 / 6.0f}};
HWY_ALIGN constexpr float kSlope[3][4] = {{-0.5f, 0, 0.5f, 0}, {1, -2, 1, 0}, {-0.5f, 1.5f, -1.5f, 0.5f}};

HWY_INLINE Float4 weights(float t) {
  const Float4 x = all4(t);
  return ((load4(kWeight[3]) * x + load4(kWeight[2])) * x + load4(kWeight[1])) * x + load4(kWeight[0]);
}
HWY_INLINE Float4 slopes(float t) {
  const Float4 x = all4(t);
  return (load4(kSlope[2]) * x + load4(kSlope[1])) * x + load4(kSlope[0]);
}

template <class T>
HWY_INLINE void spline_at(const BrickView<T>& coefficients, const SamplingMap& map, const double* point,
                          double* sample) {
  const Quad x = to_voxels(map, point);
  if (!between(load_four(map.low), x, load_four(map.high))) return write_outside(map, sample);
  const Cell c = cell_of(x);
  constexpr std::ptrdiff_t row = BrickLayout::kRow, slice = BrickLayout::kSlice;
  const T* const first = coefficients.cell(c.i, c.j, c.k) - (1 + row + slice);

  const auto u = static_cast<float>(c.u), v = static_cast<float>(c.v), w = static_cast<float>(c.w);
  const Float4 sums =
      sum_64([&](int b, int e) HWY_ATTR { return load_rows(first + b * row + e * slice, row); },
             {weights(u), slopes(u), weights(v), slopes(v), weights(w), slopes(w)});
  write_sample(map, lane_of<0>(sums), lane_of<1>(sums), lane_of<2>(sums), lane_of<3>(sums), sample);
}

void spline_i16(const BrickView<std::int16_t>& coefficients, const SamplingMap& map, const double* points,
                std::size_t count, double* samples) {
  for (; count > 0; --count, points += 3, samples += 4) spline_at(coefficients, map, points, samples);
}
void spline_float(const BrickView<float>& coefficients, const SamplingMap& map, const double* points,
                  std::size_t count, double* samples) {
  for (; count > 0; --count, points += 3, samples += 4) spline_at(coefficients, map, points, samples);
}

}  // namespace palpate::internal::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace palpate {

namespace internal {

HWY_EXPORT(spline_i16);
HWY_EXPORT(spline_float);

}  // namespace internal

// Highway prefixes the function with its target's namespace, where there is only one target
using namespace internal;

// points are processed one after the other: sixteen rows of four already fill the vectors, while one point
// per lane would need a gather for every coefficient
void sample_spline(const SplineField& field, std::span<const Point<Patient>> points,
                   std::span<FieldSample> samples) {
  PALPATE_CHECK(points.size() == samples.size());
  if (points.empty()) return;
  const double* const first = points.front().eigen().data();
  double* const out = &samples.front().value;
  if (const auto* steps = std::get_if<Bricks<std::int16_t>>(&field.coefficients())) {
    HWY_DYNAMIC_DISPATCH(spline_i16)(steps->view(), field.map(), first, points.size(), out);
  } else {
    const auto& floats = *std::get_if<Bricks<float>>(&field.coefficients());
    HWY_DYNAMIC_DISPATCH(spline_float)(floats.view(), field.map(), first, points.size(), out);
  }
}

FieldSample sample_spline(const SplineField& field, const Point<Patient>& x) {
  FieldSample sample;
  sample_spline(field, {&x, 1}, {&sample, 1});
  return sample;
}

}  // namespace palpate
#endif  // HWY_ONCE
