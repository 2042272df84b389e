#include "palpate/sampling/sampling.h"

// The founding method's sample needs seven trilinear interpolations: at x, and at x +- 1 voxel along i, j, k.
// They share the fraction (u, v, w) of x in its cell, because the offsets are whole voxels. The 7 x 8 corners
// are therefore only 32 different voxels in 12 rows along i, denoted by j and k relative to the cell:
//
//     k+2         (0,2) (1,2)
//     k+1  (-1,1) (0,1) (1,1) (2,1)        the four in the middle are needed from i-1 to i+2,
//     k    (-1,0) (0,0) (1,0) (2,0)        the others from i to i+1
//     k-1         (0,-1) (1,-1)
//
// A row is one vector (a b e f). With r_jk for the row and B(.) for the bilinear interpolation of four rows
// by v and w,
//
//     V = B(r_00,          r_10,          r_01,          r_11)
//     J = B(r_10 - r_-1,0, r_20 - r_00,   r_11 - r_-1,1, r_21 - r_01)
//     K = B(r_01 - r_0,-1, r_11 - r_1,-1, r_02 - r_00,   r_12 - r_10)
//
// and the value and twice the central differences are dot products along i, with the weights
// p = (0, 1-u, u, 0) for interpolation and q = (-(1-u), -u, 1-u, u) for differences:
//
//     f = p V,   2 g_i = q V,   2 g_j = p J,   2 g_k = p K
//
// Differences of rows are exact integers; all else is in double. The factor 1/2 is in SamplingMap.

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "sampling/central_differences.cc"
#include <hwy/foreach_target.h>
// after foreach_target.h
#include <hwy/highway.h>

#include "sampling/vectors-inl.h"

HWY_BEFORE_NAMESPACE();
namespace palpate::internal::HWY_NAMESPACE {

#if HWY_TARGET == HWY_SCALAR

struct Row {
  std::int32_t lane[4];
};
template <class T>
HWY_INLINE Row load_row(const T* p) {
  return {{p[0], p[1], p[2], p[3]}};
}
HWY_INLINE Row operator-(const Row& a, const Row& b) {
  Row result;
  for (int n = 0; n < 4; ++n) result.lane[n] = a.lane[n] - b.lane[n];
  return result;
}
HWY_INLINE Quad to_doubles(const Row& row) {
  return each_part([&](int n) HWY_ATTR { return hn::Set(D4(), static_cast<double>(row.lane[n])); });
}
/// Horizontal sums of two quads, in the order (0 + 2) + (1 + 3).
HWY_INLINE void add_up(const Quad& a, const Quad& b, double& sum_a, double& sum_b) {
  sum_a = (lane<0>(a) + lane<2>(a)) + (lane<1>(a) + lane<3>(a));
  sum_b = (lane<0>(b) + lane<2>(b)) + (lane<1>(b) + lane<3>(b));
}

#else

using Int4 = hn::FixedTag<std::int32_t, 4>;
/// Four voxels along i.
struct Row {
  hn::Vec<Int4> lanes;
};
template <class T>
HWY_INLINE Row load_row(const T* p) {
  return {hn::PromoteTo(Int4(), hn::LoadU(hn::Rebind<T, Int4>(), p))};
}
HWY_INLINE Row operator-(const Row& a, const Row& b) {
  return {hn::Sub(a.lanes, b.lanes)};
}
#if HWY_MAX_BYTES == 16
HWY_INLINE Quad to_doubles(const Row& row) {
  const hn::Half<Int4> half;
  return {{hn::PromoteTo(D4(), hn::LowerHalf(half, row.lanes)),
           hn::PromoteTo(D4(), hn::UpperHalf(half, row.lanes))}};
}
#else
HWY_INLINE Quad to_doubles(const Row& row) {
  return {{hn::PromoteTo(D4(), row.lanes)}};
}
#endif
/// Horizontal sums of two quads, in the order (0 + 2) + (1 + 3).
HWY_INLINE void add_up(const Quad& a, const Quad& b, double& sum_a, double& sum_b) {
  const hn::FixedTag<double, 2> d;
  const auto half_a = hn::Add(half_of<0>(a), half_of<1>(a));
  const auto half_b = hn::Add(half_of<0>(b), half_of<1>(b));
  const auto sums = hn::Add(hn::InterleaveLower(d, half_a, half_b), hn::InterleaveUpper(d, half_a, half_b));
  sum_a = hn::GetLane(sums);
  sum_b = hn::GetLane(hn::DupOdd(sums));
}

#endif

template <class T>
HWY_INLINE void sample_one(const BrickView<T>& voxels, const SamplingMap& map, const double* point,
                           double* sample) {
  const Quad x = to_voxels(map, point);
  if (!between(load_four(map.low), x, load_four(map.high))) return write_outside(map, sample);
  const Cell c = cell_of(x);
  constexpr std::ptrdiff_t row = BrickLayout::kRow, slice = BrickLayout::kSlice;
  const T* const first = voxels.cell(c.i, c.j, c.k) - 1;
  const auto r = [&](int dj, int dk) HWY_ATTR { return load_row(first + dj * row + dk * slice); };

  // bilinear weights along j and k
  const double v1 = 1 - c.v, w1 = 1 - c.w;
  const Quad w00 = all_four(v1 * w1), w10 = all_four(c.v * w1);
  const Quad w01 = all_four(v1 * c.w), w11 = all_four(c.v * c.w);
  const auto blend = [&](const Row& a, const Row& b, const Row& e, const Row& f) HWY_ATTR {
    return (to_doubles(a) * w00 + to_doubles(b) * w10) + (to_doubles(e) * w01 + to_doubles(f) * w11);
  };

  // reduces twelve rows to three
  const Row r00 = r(0, 0), r10 = r(1, 0), r01 = r(0, 1), r11 = r(1, 1);
  const Quad V = blend(r00, r10, r01, r11);
  const Quad J = blend(r10 - r(-1, 0), r(2, 0) - r00, r11 - r(-1, 1), r(2, 1) - r01);
  const Quad K = blend(r01 - r(0, -1), r11 - r(1, -1), r(0, 2) - r00, r(1, 2) - r10);

  // weights along i, (0 1-u u 0) and (-(1-u) -u 1-u u), as constant + u * slope
  HWY_ALIGN static constexpr double kConstantP[4] = {0, 1, 0, 0}, kSlopeP[4] = {0, -1, 1, 0};
  HWY_ALIGN static constexpr double kConstantQ[4] = {-1, 0, 1, 0}, kSlopeQ[4] = {1, -1, -1, 1};
  const Quad u = all_four(c.u);
  const Quad p = load_four(kConstantP) + u * load_four(kSlopeP);
  const Quad q = load_four(kConstantQ) + u * load_four(kSlopeQ);
  double value, gi, gj, gk;
  add_up(V * p, V * q, value, gi);
  add_up(J * p, K * p, gj, gk);
  write_sample(map, value, gi, gj, gk, sample);
}

void central_differences_u8(const BrickView<std::uint8_t>& voxels, const SamplingMap& map,
                            const double* point, double* sample) {
  sample_one(voxels, map, point, sample);
}
void central_differences_u16(const BrickView<std::uint16_t>& voxels, const SamplingMap& map,
                             const double* point, double* sample) {
  sample_one(voxels, map, point, sample);
}
void central_differences_i16(const BrickView<std::int16_t>& voxels, const SamplingMap& map,
                             const double* point, double* sample) {
  sample_one(voxels, map, point, sample);
}

}  // namespace palpate::internal::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace palpate {

namespace internal {

HWY_EXPORT(central_differences_u8);
HWY_EXPORT(central_differences_u16);
HWY_EXPORT(central_differences_i16);

}  // namespace internal

// Highway prefixes the function with its target's namespace, where there is only one target
using namespace internal;

FieldSample sample_central_differences(const Field& field, const Point<Patient>& x) {
  FieldSample sample;
  const double* const point = x.eigen().data();
  if (const auto* bytes = std::get_if<Bricks<std::uint8_t>>(&field.bricks())) {
    HWY_DYNAMIC_DISPATCH(central_differences_u8)(bytes->view(), field.map(), point, &sample.value);
  } else {
    const auto& words = *std::get_if<Bricks<std::uint16_t>>(&field.bricks());
    HWY_DYNAMIC_DISPATCH(central_differences_u16)(words.view(), field.map(), point, &sample.value);
  }
  return sample;
}

FieldSample sample_central_differences(const SignedField& field, const Point<Patient>& x) {
  FieldSample sample;
  HWY_DYNAMIC_DISPATCH(central_differences_i16)
  (field.bricks().view(), field.map(), x.eigen().data(), &sample.value);
  return sample;
}

}  // namespace palpate
#endif  // HWY_ONCE
