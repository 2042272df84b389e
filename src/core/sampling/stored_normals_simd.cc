#include "sampling/stored_normals_simd.h"

// The eight voxels around x are the lanes of one vector, of two 128-bit vectors, or of eight scalars:
//
//     lane  0 1 2 3 4 5 6 7
//     i     . + . + . + . +
//     j     . . + + . . + +
//     k     . . . . + + + +
//
// Lanes are independent until the five horizontal sums, which are taken in one order on every target; square
// root and division are correctly rounded by IEEE 754, and no operation is fused. Results are therefore
// bit-identical on every target.
//
// Compiled once per target by foreach_target.h. Only code marked HWY_INLINE and the function at the end are
// in the target's namespace, and no standard library function is called there.

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "sampling/stored_normals_simd.cc"
#include <hwy/foreach_target.h>
// after foreach_target.h
#include <hwy/highway.h>

#include "sampling/vectors-inl.h"

HWY_BEFORE_NAMESPACE();
namespace palpate::internal::stored_normals::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
namespace rows = internal::HWY_NAMESPACE;

HWY_INLINE int floor_to_int(double x) {
  const int truncated = static_cast<int>(x);
  return truncated - (x < truncated ? 1 : 0);
}

/// Sign-extended bit field of bits kFirst ... kFirst + kBits - 1.
template <int kFirst, int kBits, class DI>
HWY_INLINE hn::Vec<DI> signed_field(DI, hn::Vec<DI> voxel) {
  return hn::ShiftRight<32 - kBits>(hn::ShiftLeft<32 - kFirst - kBits>(voxel));
}

template <class D, class DI>
HWY_INLINE void read_bytes(D d, DI di, hn::Vec<DI> voxel, hn::Vec<D>& x, hn::Vec<D>& y, hn::Vec<D>& z) {
  const auto scale = hn::Set(d, 1.0f / 127);
  x = hn::Mul(hn::ConvertTo(d, signed_field<8, 8>(di, voxel)), scale);
  y = hn::Mul(hn::ConvertTo(d, signed_field<16, 8>(di, voxel)), scale);
  z = hn::Mul(hn::ConvertTo(d, signed_field<24, 8>(di, voxel)), scale);
}

/// decode_octahedral(); 0 where a is the code for no normal, -levels - 1.
template <int kBits, class D, class DI>
HWY_INLINE void read_octahedral(D d, DI di, hn::Vec<DI> voxel, hn::Vec<D>& x, hn::Vec<D>& y, hn::Vec<D>& z) {
  constexpr int kLevels = (1 << (kBits - 1)) - 1;
  const auto scale = hn::Set(d, 1.0f / kLevels), one = hn::Set(d, 1.0f);
  const auto a = signed_field<8, kBits>(di, voxel), b = signed_field<8 + kBits, kBits>(di, voxel);
  x = hn::Mul(hn::ConvertTo(d, a), scale);
  y = hn::Mul(hn::ConvertTo(d, b), scale);
  z = hn::Sub(hn::Sub(one, hn::Abs(x)), hn::Abs(y));
  const auto fold = hn::Max(hn::Neg(z), hn::Zero(d));
  x = hn::Sub(x, hn::CopySignToAbs(fold, x));
  y = hn::Sub(y, hn::CopySignToAbs(fold, y));
  const auto length = hn::Sqrt(hn::Add(hn::Add(hn::Mul(x, x), hn::Mul(y, y)), hn::Mul(z, z)));
  const auto none = hn::RebindMask(d, hn::Eq(a, hn::Set(di, -kLevels - 1)));
  const auto per_length = hn::IfThenZeroElse(none, hn::Div(one, length));
  x = hn::Mul(x, per_length);
  y = hn::Mul(y, per_length);
  z = hn::Mul(z, per_length);
}

struct alignas(32) Corners {
  std::int32_t offset[8];  ///< bytes from the cell's first voxel
  float fraction[3][8];    ///< distance from the corner to x along each axis, in voxels
};

HWY_INLINE float sum_of_eight(const float* p) {
  return ((p[0] + p[1]) + (p[2] + p[3])) + ((p[4] + p[5]) + (p[6] + p[7]));
}

template <NormalEncoding kEncoding>
HWY_INLINE void sample_one(const StoredGrid& grid, const StoredPoint& point, double* sample) {
  // more than a voxel outside, or NaN
  store_four(rows::all_four(0), sample);
  for (int a = 0; a < 3; ++a) {
    if (!(point.x[a] > -1 && point.x[a] < grid.dims[a])) return;
  }

  const std::uint8_t* cell = grid.cell;
  float before[3], after[3];
  for (int a = 0; a < 3; ++a) {
    const int corner = floor_to_int(point.x[a]);
    cell += static_cast<std::ptrdiff_t>(corner) * grid.stride[a];
    before[a] = static_cast<float>(point.x[a] - corner);
    after[a] = static_cast<float>(point.x[a] - corner - 1);
  }

  const hn::CappedTag<float, 8> d;
  const hn::RebindToSigned<decltype(d)> di;
  alignas(32) float sums[5][8];
  for (int lane = 0; lane < 8; lane += static_cast<int>(hn::Lanes(d))) {
    const auto corner = hn::Iota(di, lane);
    hn::Vec<decltype(di)> offset = hn::Zero(di);
    hn::Vec<decltype(d)> delta[3];
    for (int a = 0; a < 3; ++a) {
      const auto bit = hn::Set(di, 1 << a);
      const auto far = hn::Eq(hn::And(corner, bit), bit);
      offset = hn::Add(offset, hn::IfThenElseZero(far, hn::Set(di, grid.stride[a])));
      delta[a] = hn::IfThenElse(hn::RebindMask(d, far), hn::Set(d, after[a]), hn::Set(d, before[a]));
    }
    auto squared = hn::Zero(d);
    for (int row = 0; row < 3; ++row) {
      const float* m = grid.mm_of_voxel[row];
      const auto x = hn::Mul(hn::Set(d, m[0]), delta[0]);
      const auto y = hn::Mul(hn::Set(d, m[1]), delta[1]);
      const auto z = hn::Mul(hn::Set(d, m[2]), delta[2]);
      const auto mm = hn::Add(hn::Add(x, y), z);
      squared = hn::Add(squared, hn::Mul(mm, mm));
    }
    const auto epsilon = hn::Set(d, static_cast<float>(StoredNormals::kEpsilonMm));
    const auto weight = hn::Div(hn::Set(d, 1.0f), hn::Add(hn::Sqrt(squared), epsilon));

    const auto voxel = hn::GatherOffset(di, reinterpret_cast<const std::int32_t*>(cell), offset);
    const auto magnitude = hn::ConvertTo(d, hn::And(voxel, hn::Set(di, 255)));
    hn::Vec<decltype(d)> x, y, z;
    if constexpr (kEncoding == NormalEncoding::kBytes) {
      read_bytes(d, di, voxel, x, y, z);
    } else if constexpr (kEncoding == NormalEncoding::kOctahedral16) {
      read_octahedral<8>(d, di, voxel, x, y, z);
    } else {
      read_octahedral<12>(d, di, voxel, x, y, z);
    }
    hn::Store(weight, d, sums[0] + lane);
    hn::Store(hn::Mul(weight, magnitude), d, sums[1] + lane);
    hn::Store(hn::Mul(weight, x), d, sums[2] + lane);
    hn::Store(hn::Mul(weight, y), d, sums[3] + lane);
    hn::Store(hn::Mul(weight, z), d, sums[4] + lane);
  }

  const double value = sum_of_eight(sums[1]) / (255 * sum_of_eight(sums[0]));
  const float x = sum_of_eight(sums[2]), y = sum_of_eight(sums[3]), z = sum_of_eight(sums[4]);
  const double squared = static_cast<double>(x) * x + static_cast<double>(y) * y + static_cast<double>(z) * z;
  const hn::CappedTag<double, 1> one;
  const double length = squared == 0 ? 1 : hn::GetLane(hn::Sqrt(hn::Set(one, squared)));
  // minus the normal, in the direction of a gradient
  const auto component = [&](float c)
                             HWY_ATTR { return 0 - static_cast<double>(static_cast<float>(c / length)); };
  store_four(rows::of_four(value, component(x), component(y), component(z)), sample);
}

template <NormalEncoding kEncoding>
HWY_INLINE void sample_all(const StoredGrid& grid, const StoredPoint* points, std::size_t count,
                           double* samples) {
  for (std::size_t n = 0; n < count; ++n) sample_one<kEncoding>(grid, points[n], samples + 4 * n);
}

void sample_voxels(const StoredGrid& grid, const StoredPoint* points, std::size_t count, double* samples) {
  switch (grid.encoding) {
    case NormalEncoding::kBytes:
      return sample_all<NormalEncoding::kBytes>(grid, points, count, samples);
    case NormalEncoding::kOctahedral16:
      return sample_all<NormalEncoding::kOctahedral16>(grid, points, count, samples);
    case NormalEncoding::kOctahedral24:
      return sample_all<NormalEncoding::kOctahedral24>(grid, points, count, samples);
  }
}

}  // namespace palpate::internal::stored_normals::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace palpate::internal::stored_normals {

HWY_EXPORT(sample_voxels);

void sample_stored(const StoredGrid& grid, const StoredPoint* points, std::size_t count, double* samples) {
  HWY_DYNAMIC_DISPATCH(sample_voxels)(grid, points, count, samples);
}

}  // namespace palpate::internal::stored_normals
#endif  // HWY_ONCE
