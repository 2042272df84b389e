#include <algorithm>

#include "palpate/sampling/sampling.h"
#include "sampling/point_group.h"

// Batch version of central_differences.cc, one point per lane. A 32-bit load reads the four bytes of a row at
// once, or two 16-bit voxels. Points are processed in groups of kPointsInGroup: cells are located in double
// as for a single point, voxels are interpolated in float, and results are transformed to the patient frame
// in double. A point outside is moved to the border, where all voxels around it are `outside`.

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "sampling/central_differences_batch.cc"
#include <hwy/foreach_target.h>
// after foreach_target.h
#include <hwy/highway.h>

#include "sampling/four_rows-inl.h"
#include "sampling/vectors-inl.h"

HWY_BEFORE_NAMESPACE();
namespace palpate::internal::HWY_NAMESPACE {

using DD = hn::ScalableTag<double>;
using DF = hn::ScalableTag<float>;
using DI = hn::ScalableTag<std::int32_t>;
using VF = hn::Vec<DF>;
using VI = hn::Vec<DI>;

// ---- point location -------------------------------------------------------------------------------

/// Clamps to low ... high; NaN becomes low.
HWY_INLINE hn::Vec<DD> clamped(hn::Vec<DD> x, double low, double high) {
  const auto least = hn::Set(DD(), low), most = hn::Set(DD(), high);
  const auto above = hn::IfThenElse(hn::Gt(x, least), x, least);
  return hn::IfThenElse(hn::Lt(above, most), above, most);
}

template <class T>
HWY_INLINE void find_cells(const BrickView<T>& voxels, const SamplingMap& map, const double* points,
                           PointGroup& group) {
  const auto& c = map.voxel_columns;
  const auto to_axis = [&](int axis, hn::Vec<DD> x, hn::Vec<DD> y, hn::Vec<DD> z) HWY_ATTR {
    const auto index =
        hn::Add(hn::Add(hn::Mul(hn::Set(DD(), c[0][axis]), x), hn::Mul(hn::Set(DD(), c[1][axis]), y)),
                hn::Add(hn::Mul(hn::Set(DD(), c[2][axis]), z), hn::Set(DD(), c[3][axis])));
    return clamped(index, map.low[axis], map.high[axis]);
  };
  const hn::Rebind<float, DD> d_float;
  const hn::Rebind<std::int32_t, DD> d_int;
  std::int32_t brick[kPointsInGroup], voxel_offset[kPointsInGroup];
  for (std::size_t n = 0; n < kPointsInGroup; n += hn::Lanes(DD())) {
    hn::Vec<DD> x, y, z;
    hn::LoadInterleaved3(DD(), points + 3 * n, x, y, z);
    const auto i = to_axis(0, x, y, z), j = to_axis(1, x, y, z), k = to_axis(2, x, y, z);
    const auto fi = hn::Floor(i), fj = hn::Floor(j), fk = hn::Floor(k);
    hn::StoreU(hn::DemoteTo(d_float, hn::Sub(i, fi)), d_float, group.u + n);
    hn::StoreU(hn::DemoteTo(d_float, hn::Sub(j, fj)), d_float, group.v + n);
    hn::StoreU(hn::DemoteTo(d_float, hn::Sub(k, fk)), d_float, group.w + n);

    // as in BrickView::cell
    using L = BrickLayout;
    const auto from_border = [&](auto f) HWY_ATTR {
      return hn::Add(hn::DemoteTo(d_int, f), hn::Set(d_int, L::kBorder));
    };
    const auto a = from_border(fi), b = from_border(fj), e = from_border(fk);
    const auto at = [&](auto along_i, auto along_j, auto along_k, auto row, auto slice) HWY_ATTR {
      return hn::Add(along_i, hn::Add(hn::Mul(along_j, hn::Set(d_int, static_cast<std::int32_t>(row))),
                                      hn::Mul(along_k, hn::Set(d_int, static_cast<std::int32_t>(slice)))));
    };
    const auto in_table = [](auto from) HWY_ATTR { return hn::ShiftRight<hwy::CeilLog2(L::kCells)>(from); };
    const auto in_brick = [&](auto from) HWY_ATTR { return hn::And(from, hn::Set(d_int, L::kCells - 1)); };
    hn::StoreU(at(in_table(a), in_table(b), in_table(e), voxels.row, voxels.slice), d_int, brick + n);
    hn::StoreU(at(in_brick(a), in_brick(b), in_brick(e), L::kRow, L::kSlice), d_int, voxel_offset + n);
  }
  constexpr std::ptrdiff_t kFirst = BrickLayout::kBefore * (1 + BrickLayout::kRow + BrickLayout::kSlice) - 1;
  for (std::size_t n = 0; n < kPointsInGroup; ++n)
    group.cell[n] = voxels.table[brick[n]] + (kFirst + voxel_offset[n]);
}

// ---- interpolation ----------------------------------------------------------------------------------

/// Loads 32 bits at an offset in voxels from each lane's cell, aligned or not, with scalar loads: faster than
/// the gather instructions of AVX2 and AVX-512, which would need 64-bit addresses here.
template <class T>
HWY_INLINE VI load_each(const void* const* cells, std::ptrdiff_t beyond) {
#if HWY_TARGET == HWY_SCALAR
  std::int32_t word;
  hwy::CopyBytes<sizeof word>(static_cast<const T*>(cells[0]) + beyond, &word);
  return hn::Set(DI(), word);
#else
  const hn::FixedTag<std::uint8_t, 4> four_bytes;
  return joined<static_cast<int>(hn::MaxLanes(DI()))>([&](int n) HWY_ATTR {
    const auto* const bytes = reinterpret_cast<const std::uint8_t*>(static_cast<const T*>(cells[n]) + beyond);
    return hn::BitCast(hn::FixedTag<std::int32_t, 1>(), hn::LoadU(four_bytes, bytes));
  });
#endif
}

/// The two voxels of a row on either side of the point, as floats.
struct Two {
  VF b, e;
};
/// The two voxels of a row on either side of the point and their outer neighbours, as floats.
struct Four {
  VF a, b, e, f;
};

template <int kBits, bool kSigned>
HWY_INLINE VF voxel_in(VI word, int from_bit) {
  if constexpr (kSigned) {
    return hn::ConvertTo(DF(), hn::ShiftRight<32 - kBits>(hn::ShiftLeftSame(word, 32 - kBits - from_bit)));
  } else {
    const hn::RebindToUnsigned<DI> d;
    const auto field = hn::ShiftRightSame(hn::BitCast(d, word), from_bit);
    return hn::ConvertTo(DF(), hn::BitCast(DI(), hn::And(field, hn::Set(d, (1u << kBits) - 1))));
  }
}

template <class T>
HWY_INLINE Two load_two(const void* const* cells, std::ptrdiff_t beyond) {
  if constexpr (sizeof(T) == 1) {
    const VI word = load_each<T>(cells, beyond);
    return {voxel_in<8, false>(word, 8), voxel_in<8, false>(word, 16)};
  } else {
    const VI word = load_each<T>(cells, beyond + 1);
    return {voxel_in<16, T(-1) < 0>(word, 0), voxel_in<16, T(-1) < 0>(word, 16)};
  }
}
template <class T>
HWY_INLINE Four load_four_voxels(const void* const* cells, std::ptrdiff_t beyond) {
  const VI first = load_each<T>(cells, beyond);
  if constexpr (sizeof(T) == 1) {
    return {voxel_in<8, false>(first, 0), voxel_in<8, false>(first, 8), voxel_in<8, false>(first, 16),
            voxel_in<8, false>(first, 24)};
  } else {
    const VI second = load_each<T>(cells, beyond + 2);
    return {voxel_in<16, T(-1) < 0>(first, 0), voxel_in<16, T(-1) < 0>(first, 16),
            voxel_in<16, T(-1) < 0>(second, 0), voxel_in<16, T(-1) < 0>(second, 16)};
  }
}

HWY_INLINE VF lerp(VF a, VF b, VF t) {
  return hn::Add(a, hn::Mul(t, hn::Sub(b, a)));
}

/// A row interpolated along i, and its difference along i.
struct Interpolated {
  VF value, difference;
};
HWY_INLINE Interpolated along_i(const Four& row, VF u) {
  return {lerp(row.b, row.e, u), hn::Sub(lerp(row.e, row.f, u), lerp(row.a, row.b, u))};
}

template <class T>
HWY_INLINE void sample_lanes(PointGroup& group, std::size_t n) {
  // a local copy that no store can alias
  const void* cells[hn::MaxLanes(DF())];
  std::copy_n(group.cell + n, hn::MaxLanes(DF()), cells);
  const VF u = hn::Load(DF(), group.u + n), v = hn::Load(DF(), group.v + n), w = hn::Load(DF(), group.w + n);
  const auto row = [](int dj, int dk) { return dj * BrickLayout::kRow + dk * BrickLayout::kSlice; };
  const auto outer = [&](int dj, int dk) HWY_ATTR {
    const Two two = load_two<T>(cells, row(dj, dk));
    return lerp(two.b, two.e, u);
  };
  const auto inner = [&](int dj, int dk)
                         HWY_ATTR { return along_i(load_four_voxels<T>(cells, row(dj, dk)), u); };

  // bilinear weights along j and k
  const VF one = hn::Set(DF(), 1);
  const VF v1 = hn::Sub(one, v), w1 = hn::Sub(one, w);
  const VF w00 = hn::Mul(v1, w1), w10 = hn::Mul(v, w1), w01 = hn::Mul(v1, w), w11 = hn::Mul(v, w);
  const auto blend = [&](VF a, VF b, VF e, VF f) HWY_ATTR {
    return hn::Add(hn::Add(hn::Mul(a, w00), hn::Mul(b, w10)), hn::Add(hn::Mul(e, w01), hn::Mul(f, w11)));
  };

  const Interpolated r00 = inner(0, 0), r10 = inner(1, 0), r01 = inner(0, 1), r11 = inner(1, 1);
  hn::Store(blend(r00.value, r10.value, r01.value, r11.value), DF(), group.value + n);
  hn::Store(blend(r00.difference, r10.difference, r01.difference, r11.difference), DF(), group.gi + n);
  hn::Store(blend(hn::Sub(r10.value, outer(-1, 0)), hn::Sub(outer(2, 0), r00.value),
                  hn::Sub(r11.value, outer(-1, 1)), hn::Sub(outer(2, 1), r01.value)),
            DF(), group.gj + n);
  hn::Store(blend(hn::Sub(r01.value, outer(0, -1)), hn::Sub(r11.value, outer(1, -1)),
                  hn::Sub(outer(0, 2), r00.value), hn::Sub(outer(1, 2), r10.value)),
            DF(), group.gk + n);
}

// ---- transform to the patient frame -----------------------------------------------------------------

HWY_INLINE void write_samples(const SamplingMap& map, const PointGroup& group, double* samples) {
  const hn::Rebind<float, DD> d_float;
  const auto& c = map.sample_columns;
  for (std::size_t n = 0; n < kPointsInGroup; n += hn::Lanes(DD())) {
    const auto widened = [&](const float* p)
                             HWY_ATTR { return hn::PromoteTo(DD(), hn::LoadU(d_float, p + n)); };
    const auto value = widened(group.value), gi = widened(group.gi), gj = widened(group.gj),
               gk = widened(group.gk);
    const auto to_axis = [&](int axis) HWY_ATTR {
      return hn::Add(hn::Add(hn::Mul(hn::Set(DD(), c[0][axis]), gi), hn::Mul(hn::Set(DD(), c[1][axis]), gj)),
                     hn::Mul(hn::Set(DD(), c[2][axis]), gk));
    };
    hn::StoreInterleaved4(hn::Add(hn::Mul(hn::Set(DD(), c[3][0]), value), hn::Set(DD(), c[4][0])), to_axis(1),
                          to_axis(2), to_axis(3), DD(), samples + 4 * n);
  }
}

/// Samples `groups` whole groups of kPointsInGroup points.
template <class T>
HWY_INLINE void sample_groups(const BrickView<T>& voxels, const SamplingMap& map, const double* points,
                              std::size_t groups, double* samples) {
  PointGroup group;
  for (; groups > 0; --groups, points += 3 * kPointsInGroup, samples += 4 * kPointsInGroup) {
    find_cells(voxels, map, points, group);
    for (std::size_t n = 0; n < kPointsInGroup; n += hn::Lanes(DF())) sample_lanes<T>(group, n);
    write_samples(map, group, samples);
  }
}

void sample_groups_u8(const BrickView<std::uint8_t>& voxels, const SamplingMap& map, const double* points,
                      std::size_t groups, double* samples) {
  sample_groups(voxels, map, points, groups, samples);
}
void sample_groups_u16(const BrickView<std::uint16_t>& voxels, const SamplingMap& map, const double* points,
                       std::size_t groups, double* samples) {
  sample_groups(voxels, map, points, groups, samples);
}
void sample_groups_i16(const BrickView<std::int16_t>& voxels, const SamplingMap& map, const double* points,
                       std::size_t groups, double* samples) {
  sample_groups(voxels, map, points, groups, samples);
}

}  // namespace palpate::internal::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace palpate {

namespace internal {

namespace {

HWY_EXPORT(sample_groups_u8);
HWY_EXPORT(sample_groups_u16);
HWY_EXPORT(sample_groups_i16);

void sample_groups(const BrickView<std::uint8_t>& voxels, const SamplingMap& map, const double* points,
                   std::size_t groups, double* samples) {
  HWY_DYNAMIC_DISPATCH(sample_groups_u8)(voxels, map, points, groups, samples);
}
void sample_groups(const BrickView<std::uint16_t>& voxels, const SamplingMap& map, const double* points,
                   std::size_t groups, double* samples) {
  HWY_DYNAMIC_DISPATCH(sample_groups_u16)(voxels, map, points, groups, samples);
}
void sample_groups(const BrickView<std::int16_t>& voxels, const SamplingMap& map, const double* points,
                   std::size_t groups, double* samples) {
  HWY_DYNAMIC_DISPATCH(sample_groups_i16)(voxels, map, points, groups, samples);
}

template <class T, class AnyField>
void sample_all(const Bricks<T>& voxels, const AnyField& field, std::span<const Point<Patient>> points,
                std::span<FieldSample> samples) {
  PALPATE_CHECK(points.size() == samples.size());
  if (points.empty()) return;
  const std::size_t groups = points.size() / kPointsInGroup, done = groups * kPointsInGroup,
                    remaining = points.size() - done;
  sample_groups(voxels.view(), field.map(), points.front().eigen().data(), groups, &samples.front().value);
  if (remaining == 0) return;

  // the remaining points, padded to a whole group with the last point
  std::array<Point<Patient>, kPointsInGroup> last_points;
  std::array<FieldSample, kPointsInGroup> last_samples;
  last_points.fill(points.back());
  std::copy_n(points.begin() + static_cast<std::ptrdiff_t>(done), remaining, last_points.begin());
  sample_groups(voxels.view(), field.map(), last_points.front().eigen().data(), 1,
                &last_samples.front().value);
  std::copy_n(last_samples.begin(), remaining, samples.begin() + static_cast<std::ptrdiff_t>(done));
}

}  // namespace

}  // namespace internal

void sample_central_differences(const Field& field, std::span<const Point<Patient>> points,
                                std::span<FieldSample> samples) {
  std::visit([&](const auto& voxels) { internal::sample_all(voxels, field, points, samples); },
             field.bricks());
}

void sample_central_differences(const SignedField& field, std::span<const Point<Patient>> points,
                                std::span<FieldSample> samples) {
  internal::sample_all(field.bricks(), field, points, samples);
}

}  // namespace palpate
#endif  // HWY_ONCE
