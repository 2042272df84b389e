// Smooth sphere with a radius of two voxels along every axis, the smallest: 4 x 4 x 4 voxels as the four
// planes of four_rows-inl.h. For label_sphere_simd.cc. Included once per target.
#include "sampling/four_rows-inl.h"
#include "sampling/label_members-inl.h"
#include "sampling/vectors-inl.h"

#if defined(PALPATE_SAMPLING_SMALL_SPHERE_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef PALPATE_SAMPLING_SMALL_SPHERE_INL_H_
#undef PALPATE_SAMPLING_SMALL_SPHERE_INL_H_
#else
#define PALPATE_SAMPLING_SMALL_SPHERE_INL_H_
#endif

#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace palpate::internal::label_sphere::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
namespace rows = internal::HWY_NAMESPACE;

/// Counted voxels of the rows of a part: the members if the voxel nearest to x is no member (`far`),
/// otherwise the non-members. Multiplying a part by this keeps its counted lanes and zeroes the others.
#if HWY_TARGET == HWY_SCALAR

struct Counted {
  bool lane[4];
};
HWY_INLINE rows::Part operator*(const Counted& counted, const rows::Part& part) {
  return rows::each_lane([&](int n) HWY_ATTR { return counted.lane[n] ? part.lane[n] : 0.0f; });
}
template <class Members, class T>
HWY_INLINE Counted count_rows(const Members& members, bool far, const T* p, std::ptrdiff_t) {
  return {{members.has(p[0]) == far, members.has(p[1]) == far, members.has(p[2]) == far,
           members.has(p[3]) == far}};
}
template <class Members>
HWY_INLINE bool is_far(const Members& members, std::uint32_t label) {
  return !members.has(label);
}

#else

struct Counted {
  hn::Mask<rows::DPart> lanes;
};
HWY_INLINE rows::Part operator*(const Counted& counted, const rows::Part& part) {
  return {hn::IfThenElseZero(counted.lanes, part.v)};
}
using DLabels = hn::RebindToUnsigned<rows::DPart>;
template <class Members>
HWY_INLINE hn::Mask<DLabels> is_far(const Members& members, std::uint32_t label) {
  return members.miss(DLabels(), hn::Set(DLabels(), label));
}
template <class Members, class T>
HWY_INLINE Counted count_rows(const Members& members, hn::Mask<DLabels> far, const T* p, std::ptrdiff_t row) {
  const hn::FixedTag<T, 4> dt;
  const DLabels du;
  const auto stored =
      rows::joined<rows::kRowsOfPart>([&](int n) HWY_ATTR { return hn::LoadU(dt, p + n * row); });
  return {hn::RebindMask(rows::DPart(), hn::Xor(members.miss(du, hn::PromoteTo(du, stored)), far))};
}

#endif

/// Weights t(a) and a (1 - a^2)^2 of four voxels from `start` on, a = distance / 2; cell location as in
/// cell_of(), for one axis.
struct SmallAxis {
  HWY_INLINE explicit SmallAxis(double x) {
    HWY_ALIGN static constexpr float kBefore[4] = {-0.5f, 0, 0.5f, 1}, kAfter[4] = {0.5f, 0, -0.5f, -1};
    constexpr double kMagic = 6755399441055744.0;
    const double shifted = (x - 0.5) + kMagic, fraction = x - (shifted - kMagic);
    std::int64_t bits;
    hwy::CopyBytes<sizeof(bits)>(&shifted, &bits);
    start = static_cast<std::int32_t>(bits) - 1;
    nearest = fraction < 0.5 ? 1 : 2;

    const float half = 0.5f * static_cast<float>(fraction);
    const rows::Float4 a = rows::load4(kBefore) + rows::all4(-half);
    const rows::Float4 minus_a = rows::load4(kAfter) + rows::all4(half);
    const rows::Float4 t = rows::all4(1) + a * minus_a, t2 = t * t;
    weight = t2 * t;
    slope = t2 * a;
  }
  std::ptrdiff_t start, nearest;  ///< nearest: offset from start of the voxel nearest to x
  rows::Float4 weight, slope;
};

template <class Members, class T>
HWY_INLINE void sample_small(const LabelGrid<T>& grid, const Members& members, const double* point,
                             double* sample) {
  const double *m = grid.voxel_per_mm, *t = grid.origin;
  double x[3];
  for (int a = 0; a < 3; ++a) {
    x[a] = (m[a] * point[0] + m[a + 3] * point[1]) + (m[a + 6] * point[2] + t[a]);
  }
  store_four(rows::all_four(0), sample);
  for (int a = 0; a < 3; ++a) {
    if (!(x[a] > -2 && x[a] < grid.dims[a] + 1)) return;
  }
  const SmallAxis i(x[0]), j(x[1]), k(x[2]);

  // one brick holds the whole box; the volume is surrounded by free space
  constexpr std::ptrdiff_t row = BrickLayout::kRow, slice = BrickLayout::kSlice;
  const T* const first = grid.bricks.cell(i.start + 1, j.start + 1, k.start + 1) - (1 + row + slice);
  const bool whole = i.start >= 0 && i.start + 4 <= grid.dims[0] && j.start >= 0 &&
                     j.start + 4 <= grid.dims[1] && k.start >= 0 && k.start + 4 <= grid.dims[2];

  // background is never a member
  const std::ptrdiff_t nearest = i.nearest + j.nearest * row + k.nearest * slice;
  const std::uint32_t label = whole ? first[nearest] : 0;
  const int flip = members.has(label) ? 1 : 0;
  const auto far = is_far(members, label);
  const rows::Float4 sums = rows::sum_64(
      [&](int b, int e) HWY_ATTR { return count_rows(members, far, first + b * row + e * slice, row); },
      {i.weight, i.slope, j.weight, j.slope, k.weight, k.slope});

  // (value, gradient) = value_column f + sum_a column_a s_a with the normalised sums f and s_a, by the
  // quotient rule with t' = 6/r a (1 - a^2)^2 and r = 2. All of it except the sums is independent of the
  // voxels and can be computed ahead of their loads.
  const rows::Float4 weight_sums = rows::add_up(i.weight, j.weight, k.weight, k.weight),
                     slope_sums = rows::add_up(i.slope, j.slope, k.slope, k.slope);
  const double w_i = rows::lane_of<0>(weight_sums), w_j = rows::lane_of<1>(weight_sums),
               w_k = rows::lane_of<2>(weight_sums);
  const rows::Quad drift = rows::to_doubles(slope_sums) / rows::to_doubles(weight_sums);
  static constexpr double kSign[2] = {1, -1};
  const rows::Quad per_all = rows::all_four(kSign[flip] / (w_i * w_j * w_k)),
                   three = rows::all_four(3) * per_all;
  const rows::Quad along_i = three * gradient_column(grid, 0), along_j = three * gradient_column(grid, 1),
                   along_k = three * gradient_column(grid, 2);
  HWY_ALIGN static constexpr double kValue[4] = {1, 0, 0, 0}, kWhole[2][4] = {{0, 0, 0, 0}, {1, 0, 0, 0}};
  const rows::Quad drifted =
      (along_i * rows::all_four(rows::lane<0>(drift)) + along_j * rows::all_four(rows::lane<1>(drift))) +
      along_k * rows::all_four(rows::lane<2>(drift));
  const rows::Quad of_value = rows::load_four(kValue) * per_all - drifted;
  store_four(((of_value * rows::all_four(rows::lane_of<0>(sums)) +
               along_i * rows::all_four(rows::lane_of<1>(sums))) +
              (along_j * rows::all_four(rows::lane_of<2>(sums)) +
               along_k * rows::all_four(rows::lane_of<3>(sums)))) +
                 rows::load_four(kWhole[flip]),
             sample);
}

template <class Members, class T>
HWY_INLINE void sample_all_small(const LabelGrid<T>& grid, const Members& members, const double* points,
                                 std::size_t count, double* samples) {
  for (std::size_t n = 0; n < count; ++n) sample_small(grid, members, points + 3 * n, samples + 4 * n);
}
template <class T>
HWY_INLINE void sample_all_small(const LabelGrid<T>& grid, const double* points, std::size_t count,
                                 double* samples) {
  if (grid.range_count == 1) {
    sample_all_small(grid, OneRange(grid), points, count, samples);
  } else {
    sample_all_small(grid, AnyRanges(grid), points, count, samples);
  }
}

}  // namespace palpate::internal::label_sphere::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // per target
