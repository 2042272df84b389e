#include "sampling/label_sphere_simd.h"

// Both spheres weigh a box of voxels with a product of one weight an axis, and their gradients differ from
// their values in one factor only. With w the weights, s the slopes (of the smooth sphere's weights their
// derivatives, of the Gaussian's half the differences one voxel away), L 1 for members and else 0:
//
//     A(i,k) = sum_j w_j L        V(i) = sum_k w_k A        value = sum_i w_i V     d/di = sum_i s_i V
//     B(i,k) = sum_j s_j L        Y(i) = sum_k w_k B        d/dj  = sum_i w_i Y
//                                 Z(i) = sum_k s_k A        d/dk  = sum_i w_i Z
//
// Vectors lie along i, where every lane stands for itself until the last sums, which are taken in four parts
// on every target. No operation is fused. Hence the same bits everywhere. The smallest smooth sphere, the one
// for fine points, has a form of its own in small_sphere-inl.h.
//
// The slopes sum to 0 and the weights to a known total, but not to the last bit, and deep inside the tissue a
// gradient of rounding errors would still have a direction. Where the box lies wholly inside the volume and
// the voxel nearest to x is a member, the sums are therefore taken over the voxels that are not members
// ("flipped").
//
// Compiled once per target by foreach_target.h; only what is marked HWY_INLINE and the four functions at the
// end live in the target's namespace, and nothing of the standard library is called there.

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "sampling/label_sphere_simd.cc"
#include <hwy/foreach_target.h>
// after foreach_target.h
#include <hwy/highway.h>

#include "sampling/label_members-inl.h"
#include "sampling/label_sphere_weights-inl.h"
#include "sampling/small_sphere-inl.h"

HWY_BEFORE_NAMESPACE();
namespace palpate::internal::label_sphere::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

// ---- the sums --------------------------------------------------------------------------------------------

/// The sums along j and k, one for each place along i.
struct alignas(64) ColumnSums {
  float v[kMaxCount], y[kMaxCount], z[kMaxCount];
};

/// The part of the box that lies inside the volume, as offsets from its start, ends excluded.
struct BoxPart {
  int begin[3], end[3];
  bool whole;   ///< all of the box
  bool direct;  ///< whole rows may be read where they stand, as far as vectors reach
};

template <class T>
struct Box {
  const LabelGrid<T>& grid;
  const AxisWeights (&axes)[3];
  const BoxPart& part;
};

/// The sums at lanes x ... x + Lanes(d). kFlip: over the voxels that are no members. kCount: of a box that
/// lies wholly inside, whose rows are read where they stand. -1: any box, from a copy that is 0 beyond the
/// volume.
template <bool kFlip, int kCount, class Members, class D, class T>
HWY_INLINE void sum_columns(D d, const Box<T>& box, const Members& members, int x, ColumnSums& sums) {
  const hn::Rebind<T, D> dt;
  const hn::RebindToUnsigned<D> du;
  const int* dims = box.grid.dims;
  const AxisWeights &ax = box.axes[0], &ay = box.axes[1], &az = box.axes[2];
  const auto row_length = static_cast<std::ptrdiff_t>(dims[0]);
  const std::ptrdiff_t slice_length = row_length * dims[1];

  auto v = hn::Zero(d), y = hn::Zero(d), z = hn::Zero(d);
  const int begin_j = kCount < 0 ? box.part.begin[1] : 0, end_j = count_or<kCount>(box.part.end[1]);
  const int begin_k = kCount < 0 ? box.part.begin[2] : 0, end_k = count_or<kCount>(box.part.end[2]);
  for (int k = begin_k; k < end_k; ++k) {
    std::ptrdiff_t row = (az.start + k) * slice_length + (ay.start + begin_j) * row_length + ax.start + x;
    auto a = hn::Zero(d), b = hn::Zero(d);
    for (int j = begin_j; j < end_j; ++j, row += row_length) {
      hn::Vec<decltype(du)> labels;
      if constexpr (kCount < 0) {
        alignas(64) T copy[16] = {};
        for (int i = 0; i < static_cast<int>(hn::Lanes(d)); ++i) {
          if (x + i >= box.part.begin[0] && x + i < box.part.end[0]) copy[i] = box.grid.voxels[row + i];
        }
        labels = hn::PromoteTo(du, hn::Load(dt, copy));
      } else {
        labels = hn::PromoteTo(du, hn::LoadU(dt, box.grid.voxels + row));
      }
      const auto miss = hn::RebindMask(d, members.miss(du, labels));
      const auto aw = hn::Add(a, hn::Set(d, ay.weight[j])), bs = hn::Add(b, hn::Set(d, ay.slope[j]));
      a = kFlip ? hn::IfThenElse(miss, aw, a) : hn::IfThenElse(miss, a, aw);
      b = kFlip ? hn::IfThenElse(miss, bs, b) : hn::IfThenElse(miss, b, bs);
    }
    const auto w = hn::Set(d, az.weight[k]), s = hn::Set(d, az.slope[k]);
    v = hn::Add(v, hn::Mul(w, a));
    y = hn::Add(y, hn::Mul(w, b));
    z = hn::Add(z, hn::Mul(s, a));
  }
  hn::Store(v, d, sums.v + x);
  hn::Store(y, d, sums.y + x);
  hn::Store(z, d, sums.z + x);
}

template <bool kFlip, int kCount, class Members, std::size_t kWidth, class T>
HWY_INLINE int sum_block(const Box<T>& box, int x, ColumnSums& sums) {
  const hn::CappedTag<float, kWidth> d;
  const Members members(box.grid);
  for (const int end = x + static_cast<int>(kWidth); x < end; x += static_cast<int>(hn::Lanes(d))) {
    sum_columns<kFlip, kCount>(d, box, members, x, sums);
  }
  return x;
}

template <bool kFlip, int kCount, class Members, class T>
HWY_INLINE void sum_rows(const Box<T>& box, ColumnSums& sums) {
  const int length = padded(count_or<kCount>(box.axes[0].count));
  int x = 0;
  while (length - x >= 16) x = sum_block<kFlip, kCount, Members, 16>(box, x, sums);
  if (length - x == 8) {
    sum_block<kFlip, kCount, Members, 8>(box, x, sums);
  } else if (length - x == 4) {
    sum_block<kFlip, kCount, Members, 4>(box, x, sums);
  }
}

/// Kept out of the way of the usual box's registers.
template <bool kFlip, int kCount, class T>
HWY_NOINLINE void sum_unusual(const Box<T>& box, ColumnSums& sums) {
  sum_rows<kFlip, kCount, AnyRanges>(box, sums);
}

template <bool kFlip, int kCount, class T>
HWY_INLINE void sum_box(const Box<T>& box, ColumnSums& sums) {
  if (!box.part.direct) {
    sum_unusual<kFlip, -1>(box, sums);
  } else if (box.grid.range_count == 1) {
    sum_rows<kFlip, kCount, OneRange>(box, sums);
  } else {
    sum_unusual<kFlip, kCount>(box, sums);
  }
}

/// sum_i a(i) b(i), in four parts.
template <int kCount>
HWY_INLINE float dot(const float* a, const float* b, int count) {
  const hn::CappedTag<float, 4> d;
  const int lanes = static_cast<int>(hn::Lanes(d)), length = padded(count_or<kCount>(count));
  alignas(16) float parts[4];
  for (int lane = 0; lane < 4; lane += lanes) {
    auto sum = hn::Zero(d);
    for (int i = lane; i < length; i += 4) {
      sum = hn::Add(sum, hn::Mul(hn::Load(d, a + i), hn::Load(d, b + i)));
    }
    hn::Store(sum, d, parts + lane);
  }
  return sum_of_four(parts);
}

template <class T>
HWY_INLINE std::ptrdiff_t offset_of(const LabelGrid<T>& grid, int i, int j, int k) {
  return (static_cast<std::ptrdiff_t>(k) * grid.dims[1] + j) * grid.dims[0] + i;
}

template <class T>
HWY_INLINE BoxPart part_inside(const LabelGrid<T>& grid, const AxisWeights (&axes)[3]) {
  BoxPart part;
  part.whole = true;
  for (int a = 0; a < 3; ++a) {
    const int start = axes[a].start, room = grid.dims[a] - start;
    part.begin[a] = start < 0 ? -start : 0;
    part.end[a] = room < axes[a].count ? room : axes[a].count;
    part.whole = part.whole && part.begin[a] == 0 && part.end[a] == axes[a].count;
  }
  // a vector may read beyond its row, into the next one, but not beyond the volume
  const int overshoot = padded(axes[0].count) - axes[0].count;
  part.direct = part.whole &&
                offset_of(grid, axes[0].start + axes[0].count + overshoot, axes[1].start + axes[1].count - 1,
                          axes[2].start + axes[2].count - 1) <= offset_of(grid, 0, 0, grid.dims[2]);
  return part;
}

template <int kCount, class T, class Kernel>
HWY_INLINE void sample_one(const LabelGrid<T>& grid, const Kernel& kernel, const SpherePoint& point,
                           double* sample) {
  // too far away to see a voxel, or not a number
  store_four(internal::HWY_NAMESPACE::all_four(0), sample);
  for (int a = 0; a < 3; ++a) {
    const double far = reach(kernel, a);
    if (!(point.x[a] > -far && point.x[a] < grid.dims[a] - 1 + far)) return;
  }

  AxisWeights axes[3];
  weigh(point, kernel, axes);
  const BoxPart part = part_inside(grid, axes);
  const bool flip =
      part.whole && AnyRanges(grid).has(grid.voxels[offset_of(grid, static_cast<int>(nearest(point.x[0])),
                                                              static_cast<int>(nearest(point.x[1])),
                                                              static_cast<int>(nearest(point.x[2])))]);

  ColumnSums sums;
  const Box<T> box{grid, axes, part};
  if (flip) {
    sum_box<true, kCount>(box, sums);
  } else {
    sum_box<false, kCount>(box, sums);
  }

  // normalised last, in double: the divisions wait for nothing
  const int count = axes[0].count;
  const double sign = flip ? -1 : 1;
  const double per_sum = sign * axes[0].per_sum * axes[1].per_sum * axes[2].per_sum;
  const double value = per_sum * dot<kCount>(axes[0].weight, sums.v, count);
  const double along[3] = {per_sum * dot<kCount>(axes[0].slope, sums.v, count),
                           per_sum * dot<kCount>(axes[0].weight, sums.y, count),
                           per_sum * dot<kCount>(axes[0].weight, sums.z, count)};
  const double whole = flip ? axes[0].total * axes[1].total * axes[2].total : 0;
  const auto derivative = [&](int a) HWY_ATTR {
    return gradient_column(grid, a) *
           internal::HWY_NAMESPACE::all_four(along[a] * axes[a].slope_unit - value * axes[a].drift);
  };
  store_four((internal::HWY_NAMESPACE::of_four(whole + value, 0, 0, 0) + derivative(0)) +
                 (derivative(1) + derivative(2)),
             sample);
}

template <int kCount, class T, class Kernel>
HWY_INLINE void sample_all(const LabelGrid<T>& grid, const Kernel& kernel, const SpherePoint* points,
                           std::size_t count, double* samples) {
  for (std::size_t n = 0; n < count; ++n) sample_one<kCount>(grid, kernel, points[n], samples + 4 * n);
}

void smooth_in_mask(const LabelGrid<std::uint8_t>& grid, const SmoothKernel& kernel,
                    const SpherePoint* points, std::size_t count, double* samples) {
  sample_all<0>(grid, kernel, points, count, samples);
}
void smooth_in_labels(const LabelGrid<std::uint16_t>& grid, const SmoothKernel& kernel,
                      const SpherePoint* points, std::size_t count, double* samples) {
  sample_all<0>(grid, kernel, points, count, samples);
}
void small_in_mask(const LabelGrid<std::uint8_t>& grid, const double* points, std::size_t count,
                   double* samples) {
  sample_all_small(grid, points, count, samples);
}
void small_in_labels(const LabelGrid<std::uint16_t>& grid, const double* points, std::size_t count,
                     double* samples) {
  sample_all_small(grid, points, count, samples);
}
void gaussian_in_mask(const LabelGrid<std::uint8_t>& grid, const GaussianTable& table,
                      const SpherePoint* points, std::size_t count, double* samples) {
  sample_all<7>(grid, table, points, count, samples);
}
void gaussian_in_labels(const LabelGrid<std::uint16_t>& grid, const GaussianTable& table,
                        const SpherePoint* points, std::size_t count, double* samples) {
  sample_all<7>(grid, table, points, count, samples);
}

}  // namespace palpate::internal::label_sphere::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace palpate::internal::label_sphere {

HWY_EXPORT(smooth_in_mask);
HWY_EXPORT(smooth_in_labels);
HWY_EXPORT(small_in_mask);
HWY_EXPORT(small_in_labels);
HWY_EXPORT(gaussian_in_mask);
HWY_EXPORT(gaussian_in_labels);

void sample_sphere(const LabelGrid<std::uint8_t>& grid, const SmoothKernel& kernel, const SpherePoint* points,
                   std::size_t count, double* samples) {
  HWY_DYNAMIC_DISPATCH(smooth_in_mask)(grid, kernel, points, count, samples);
}
void sample_sphere(const LabelGrid<std::uint16_t>& grid, const SmoothKernel& kernel,
                   const SpherePoint* points, std::size_t count, double* samples) {
  HWY_DYNAMIC_DISPATCH(smooth_in_labels)(grid, kernel, points, count, samples);
}
void sample_sphere(const LabelGrid<std::uint8_t>& grid, const SmallKernel&, const Point<Patient>* points,
                   std::size_t count, double* samples) {
  HWY_DYNAMIC_DISPATCH(small_in_mask)(grid, points->eigen().data(), count, samples);
}
void sample_sphere(const LabelGrid<std::uint16_t>& grid, const SmallKernel&, const Point<Patient>* points,
                   std::size_t count, double* samples) {
  HWY_DYNAMIC_DISPATCH(small_in_labels)(grid, points->eigen().data(), count, samples);
}
void sample_sphere(const LabelGrid<std::uint8_t>& grid, const GaussianTable& table, const SpherePoint* points,
                   std::size_t count, double* samples) {
  HWY_DYNAMIC_DISPATCH(gaussian_in_mask)(grid, table, points, count, samples);
}
void sample_sphere(const LabelGrid<std::uint16_t>& grid, const GaussianTable& table,
                   const SpherePoint* points, std::size_t count, double* samples) {
  HWY_DYNAMIC_DISPATCH(gaussian_in_labels)(grid, table, points, count, samples);
}

}  // namespace palpate::internal::label_sphere
#endif  // HWY_ONCE
