#include "sampling/label_sphere_simd.h"

// Both sphere filters weight a box of voxels with a separable kernel, and their gradients differ from their
// values in one factor only. With the weights w, the slopes s (derivatives of the weights for the smooth
// sphere; half the differences one voxel away for the Gaussian), and L = 1 for members and 0 otherwise:
//
//     A(i,k) = sum_j w_j L        V(i) = sum_k w_k A        value = sum_i w_i V     d/di = sum_i s_i V
//     B(i,k) = sum_j s_j L        Y(i) = sum_k w_k B        d/dj  = sum_i w_i Y
//                                 Z(i) = sum_k s_k A        d/dk  = sum_i w_i Z
//
// Vectors extend along i, where lanes are independent until the final sums, which are taken in four parts on
// every target. Voxels of a box that spans several bricks are gathered first. No operation is fused. Results
// are therefore bit-identical on every target. The smallest smooth sphere, the one for high-resolution tools,
// has a specialisation in small_sphere-inl.h.
//
// The slopes sum to 0 and the weights to a known total only up to rounding, and deep inside tissue a gradient
// of rounding errors would still have a direction. If the box is entirely inside the volume and the voxel
// nearest to x is a member, the sums are therefore taken over the non-members ("flipped").
//
// Compiled once per target by foreach_target.h. Only code marked HWY_INLINE and the four functions at the end
// are in the target's namespace, and no standard library function is called there.

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

// ---- sums ------------------------------------------------------------------------------------------------

/// Sums along j and k, for each position along i.
struct alignas(64) ColumnSums {
  float v[kMaxCount], y[kMaxCount], z[kMaxCount];
};

/// Part of the box inside the volume, as half-open offsets from its start.
struct BoxPart {
  int begin[3], end[3];
  bool whole;  ///< the whole box is inside
};

/// Along an axis, the first brick that stores voxel p has the number (p + kToFirst) / kCells and stores it at
/// position (p + kToFirst) % kCells, together with all voxels up to position kVoxels - 1.
constexpr int kToFirst = BrickLayout::kBorder + BrickLayout::kBefore, kCells = BrickLayout::kCells;
static_assert((kCells & (kCells - 1)) == 0);
HWY_INLINE int brick_of(int voxel) {
  return static_cast<int>(static_cast<unsigned>(voxel + kToFirst) / kCells);
}
HWY_INLINE int offset_of(int voxel) {
  return static_cast<int>(static_cast<unsigned>(voxel + kToFirst) % kCells);
}

template <class T>
struct Box {
  const LabelGrid<T>& grid;
  const AxisWeights (&axes)[3];
  const BoxPart& part;
};

/// Counted voxels of a block of lanes of a box, read in place from at most two bricks along each axis.
/// kTwoAlongI: the block's lanes continue in a second brick.
template <bool kTwoAlongI, class Members, class T>
struct CountedInBricks {
  HWY_INLINE CountedInBricks(const Box<T>& box, int block, const Members& counted_members)
      : members(counted_members) {
    const BrickView<T>& view = box.grid.bricks;
    const int i = box.axes[0].start + block, j = box.axes[1].start, k = box.axes[2].start;
    const T* const* table = view.table + (brick_of(i) + brick_of(j) * view.row + brick_of(k) * view.slice);
    lanes_of_first = BrickLayout::kVoxels - offset_of(i);
    first_of_second = kCells - offset_of(k);
    const int count_j = box.axes[1].count, bricks_k = box.axes[2].count > first_of_second ? 2 : 1;
    for (int c = 0; c < bricks_k; ++c, table += view.slice) {
      const std::ptrdiff_t at = offset_of(i) + (offset_of(k) - c * kCells) * BrickLayout::kSlice;
      for (int n = 0; n < count_j; ++n) {
        const int index = offset_of(j) + n;
        const T* const* brick = table + (index >= kCells ? view.row : 0);
        const std::ptrdiff_t row = (index % kCells) * BrickLayout::kRow;
        here[c][n] = brick[0] + (at + row);
        if constexpr (kTwoAlongI) next[c][n] = brick[1] + (at - kCells + row);
      }
    }
  }

  template <class D>
  HWY_INLINE hn::Mask<D> hit(D d, int lane, int j, int k) const {
    const int c = k >= first_of_second ? 1 : 0;
    const std::ptrdiff_t at = lane + k * BrickLayout::kSlice;
    auto stored = hn::LoadU(d, here[c][j] + at);
    if constexpr (kTwoAlongI) {
      const int left = lanes_of_first - lane;
      const auto is_first = hn::FirstN(d, static_cast<std::size_t>(left > 0 ? left : 0));
      stored = hn::IfThenElse(is_first, stored, hn::LoadU(d, next[c][j] + at));
    }
    return members.hit(d, stored);
  }

  static constexpr int kMaxRows = kCells + 1;
  const Members members;
  /// Number of lanes in the first brick; first slice of the second brick.
  int lanes_of_first, first_of_second;
  /// Rows of the box in this block at slice 0, in either brick along k (extrapolated if that brick does not
  /// hold slice 0).
  const T *here[2][kMaxRows], *next[2][kMaxRows];
};

/// Counted voxels of a box within one brick, the common case for small boxes, with constant strides.
template <class Members, class T>
struct CountedInOneBrick {
  HWY_INLINE CountedInOneBrick(const Box<T>& box, const Members& counted_members) : members(counted_members) {
    const BrickView<T>& view = box.grid.bricks;
    const int i = box.axes[0].start, j = box.axes[1].start, k = box.axes[2].start;
    first = view.table[brick_of(i) + brick_of(j) * view.row + brick_of(k) * view.slice] +
            (offset_of(i) + offset_of(j) * BrickLayout::kRow + offset_of(k) * BrickLayout::kSlice);
  }
  HWY_INLINE static bool holds(const Box<T>& box) {
    bool fits = box.part.whole;
    for (int a = 0; a < 3; ++a)
      fits = fits && offset_of(box.axes[a].start) + box.axes[a].count <= BrickLayout::kVoxels;
    return fits;
  }

  template <class D>
  HWY_INLINE hn::Mask<D> hit(D d, int lane, int j, int k) const {
    return members.hit(d, hn::LoadU(d, first + (lane + j * BrickLayout::kRow + k * BrickLayout::kSlice)));
  }

  const Members members;
  const T* first;
};

/// Counted voxels of a block of kWidth lanes, gathered for some slices of the box: all bits set if counted,
/// else 0. Rows are contiguous, independent of the bricks they come from. Lanes beyond the box are
/// unspecified.
template <std::size_t kWidth, class Members, class T>
struct CountedLanes {
  static constexpr int kRows = 256;
  using D = hn::CappedTag<T, kWidth>;

  HWY_INLINE CountedLanes(const Box<T>& whole_box, int first_lane, const Members& counted_members)
      : box(whole_box), members(counted_members), block(first_lane) {}

  template <class V>
  HWY_INLINE hn::Mask<V> hit(V d, int lane, int j, int k) const {
    const int row = (k - first_k) * box.axes[1].count + j;
    return hn::MaskFromVec(hn::Load(d, lanes + row * static_cast<int>(kWidth) + lane));
  }

  /// Gathers slices of the box; does not read beyond the volume.
  HWY_INLINE void gather(int begin_k, int end_k) {
    first_k = begin_k;
    T* to = lanes;
    for (int k = begin_k; k < end_k; ++k, to += box.axes[1].count * static_cast<int>(kWidth))
      gather_slice(k, to);
  }

 private:
  HWY_INLINE void gather_slice(int k, T* to) {
    if (!box.part.whole) return read_part(k, to);
    const BrickView<T>& view = box.grid.bricks;
    const int i = box.axes[0].start + block, j = box.axes[1].start, slice = box.axes[2].start + k;
    // bricks exist only for lanes inside the box
    const int left = box.axes[0].count - block, width = static_cast<int>(kWidth);
    const int needed = left < width ? left : width, in_first = BrickLayout::kVoxels - offset_of(i);
    const T* const* table =
        view.table + (brick_of(i) + brick_of(j) * view.row + brick_of(slice) * view.slice);
    const std::ptrdiff_t at = offset_of(i) + offset_of(slice) * BrickLayout::kSlice;
    int index = offset_of(j);
    for (int remaining = box.axes[1].count; remaining > 0; table += view.row, index = 0) {
      const int room = kCells - index, rows = remaining < room ? remaining : room;
      const std::ptrdiff_t first = at + index * BrickLayout::kRow;
      if (needed <= in_first) {
        gather_rows(table[0] + first, rows, to);
      } else {
        gather_rows(table[0] + first, table[1] + (first - kCells), in_first, rows, to);
      }
      remaining -= rows;
      to += rows * width;
    }
  }

  HWY_INLINE hn::Vec<D> counted(hn::Vec<D> stored) const {
    return hn::VecFromMask(D(), members.hit(D(), stored));
  }
  HWY_INLINE void gather_rows(const T* from, int rows, T* to) const {
    const D d;
    for (int n = 0; n < rows; ++n, from += BrickLayout::kRow, to += kWidth)
      for (std::size_t lane = 0; lane < kWidth; lane += hn::Lanes(d))
        hn::Store(counted(hn::LoadU(d, from + lane)), d, to + lane);
  }
  /// Gathers rows that continue in a second brick after `lanes_of_first` lanes.
  HWY_INLINE void gather_rows(const T* from, const T* then, int lanes_of_first, int rows, T* to) const {
    const D d;
    for (std::size_t lane = 0; lane < kWidth; lane += hn::Lanes(d)) {
      const int of_first = lanes_of_first - static_cast<int>(lane);
      const auto is_first = hn::FirstN(d, static_cast<std::size_t>(of_first > 0 ? of_first : 0));
      const T *a = from + lane, *b = then + lane;
      T* out = to + lane;
      for (int n = 0; n < rows; ++n, a += BrickLayout::kRow, b += BrickLayout::kRow, out += kWidth)
        hn::Store(counted(hn::IfThenElse(is_first, hn::LoadU(d, a), hn::LoadU(d, b))), d, out);
    }
  }
  /// Gathers with bounds checks; voxels outside the volume are not counted.
  HWY_INLINE void read_part(int k, T* to) const {
    const BoxPart& part = box.part;
    for (int j = 0; j < box.axes[1].count; ++j) {
      for (int i = block; i < block + static_cast<int>(kWidth); ++i) {
        const int at[3] = {i, j, k};
        bool counts = true;
        for (int a = 0; a < 3; ++a) counts = counts && at[a] >= part.begin[a] && at[a] < part.end[a];
        counts = counts && members.has(*box.grid.bricks.cell(box.axes[0].start + i, box.axes[1].start + j,
                                                             box.axes[2].start + k));
        *to++ = counts ? static_cast<T>(~T{0}) : T{0};
      }
    }
  }

  alignas(64) T lanes[kRows * kWidth];
  const Box<T>& box;
  const Members members;
  int block, first_k = 0;
};

/// Mask of the counted lanes of a row, for sums of floats. Kept as a bit mask on targets that have them,
/// otherwise as lanes of all ones or zeros.
template <class D, class DT>
struct CountedRow {
#if HWY_TARGET <= HWY_AVX3
  HWY_INLINE CountedRow(D, DT, hn::Mask<DT> narrow)
      : counts{static_cast<decltype(hn::Mask<D>::raw)>(narrow.raw)} {}
  /// @tparam kOthers  adds the lanes that are not counted
  template <bool kOthers>
  HWY_INLINE hn::Vec<D> add(hn::Vec<D> sum, hn::Vec<D> weight) const {
    const auto more = hn::Add(sum, weight);
    return kOthers ? hn::IfThenElse(counts, sum, more) : hn::IfThenElse(counts, more, sum);
  }
  hn::Mask<D> counts;
#else
  HWY_INLINE CountedRow(D d, DT dt, hn::Mask<DT> narrow) {
    const hn::RebindToSigned<DT> stored;
    const hn::RebindToSigned<D> wide;
    counts = hn::BitCast(d, hn::PromoteTo(wide, hn::BitCast(stored, hn::VecFromMask(dt, narrow))));
  }
  template <bool kOthers>
  HWY_INLINE hn::Vec<D> add(hn::Vec<D> sum, hn::Vec<D> weight) const {
    // adds 0 to the other lanes; sums are never -0
    return hn::Add(sum, kOthers ? hn::AndNot(counts, weight) : hn::And(counts, weight));
  }
  hn::Vec<D> counts;
#endif
};

/// Accumulates the sums at lanes of a block over slices begin_k ... end_k - 1. kOthers: over the voxels that
/// are not counted.
template <int kCount, bool kOthers, class D, class T, class Counts>
HWY_INLINE void sum_columns(D d, const Box<T>& box, const Counts& counts, int block, int lane, int begin_k,
                            int end_k, ColumnSums& sums) {
  const hn::Rebind<T, D> dt;
  const AxisWeights &ay = box.axes[1], &az = box.axes[2];
  const int end_j = count_or<kCount>(ay.count), x = block + lane;
  auto v = hn::Zero(d), y = hn::Zero(d), z = hn::Zero(d);
  if (begin_k > 0) {
    v = hn::Load(d, sums.v + x);
    y = hn::Load(d, sums.y + x);
    z = hn::Load(d, sums.z + x);
  }
  for (int k = begin_k; k < end_k; ++k) {
    auto a = hn::Zero(d), b = hn::Zero(d);
    for (int j = 0; j < end_j; ++j) {
      const CountedRow<D, hn::Rebind<T, D>> row(d, dt, counts.hit(dt, lane, j, k));
      a = row.template add<kOthers>(a, hn::Set(d, ay.weight[j]));
      b = row.template add<kOthers>(b, hn::Set(d, ay.slope[j]));
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

template <int kCount, std::size_t kWidth, bool kOthers = false, class T, class Counts>
HWY_INLINE void sum_slices(const Box<T>& box, const Counts& counts, int block, int begin_k, int end_k,
                           ColumnSums& sums) {
  const hn::CappedTag<float, kWidth> d;
  for (int lane = 0; lane < static_cast<int>(kWidth); lane += static_cast<int>(hn::Lanes(d)))
    sum_columns<kCount, kOthers>(d, box, counts, block, lane, begin_k, end_k, sums);
}

/// Not inlined, to keep its registers out of the common path.
template <int kCount, std::size_t kWidth, class Members, class T>
HWY_NOINLINE void sum_gathered(const Box<T>& box, int block, const Members& members, ColumnSums& sums) {
  CountedLanes<kWidth, Members, T> counts(box, block, members);
  const int end = count_or<kCount>(box.axes[2].count);
  const int at_once = counts.kRows / count_or<kCount>(box.axes[1].count);
  for (int k = 0; k < end; k += at_once) {
    const int last = k + at_once < end ? k + at_once : end;
    counts.gather(k, last);
    sum_slices<kCount, kWidth>(box, counts, block, k, last, sums);
  }
}

/// Sums of a block of kWidth lanes.
template <int kCount, std::size_t kWidth, class Members, class T>
HWY_INLINE int sum_block(const Box<T>& box, bool in_place, int block, const Members& members,
                         ColumnSums& sums) {
  const int end = count_or<kCount>(box.axes[2].count), left = box.axes[0].count - block;
  const int needed = left < static_cast<int>(kWidth) ? left : static_cast<int>(kWidth);
  if (!in_place) {
    sum_gathered<kCount, kWidth>(box, block, members, sums);
  } else if (offset_of(box.axes[0].start + block) + needed <= BrickLayout::kVoxels) {
    sum_slices<kCount, kWidth>(box, CountedInBricks<false, Members, T>(box, block, members), block, 0, end,
                               sums);
  } else {
    sum_slices<kCount, kWidth>(box, CountedInBricks<true, Members, T>(box, block, members), block, 0, end,
                               sums);
  }
  return block + static_cast<int>(kWidth);
}

template <int kCount, class Members, class T>
HWY_INLINE void sum_rows(const Box<T>& box, const Members& members, ColumnSums& sums) {
  // whether position and count exclude a third brick
  bool in_place = box.part.whole;
  for (int a = 1; a < 3; ++a) in_place = in_place && box.axes[a].count <= kCells + 1;
  const int length = padded(count_or<kCount>(box.axes[0].count));
  int x = 0;
  while (length - x >= 16) x = sum_block<kCount, 16>(box, in_place, x, members, sums);
  if (length - x == 8) {
    sum_block<kCount, 8>(box, in_place, x, members, sums);
  } else if (length - x == 4) {
    sum_block<kCount, 4>(box, in_place, x, members, sums);
  }
}

/// Not inlined, to keep its registers out of the common path.
template <int kCount, class T>
HWY_NOINLINE void sum_unusual(const Box<T>& box, bool flip, ColumnSums& sums) {
  sum_rows<kCount>(box, AnyRanges(box.grid, flip), sums);
}

template <int kCount, class T>
HWY_INLINE void sum_box(const Box<T>& box, bool flip, ColumnSums& sums) {
  if constexpr (kCount > 0) {
    constexpr std::size_t kWidth = 8;
    static_assert(kCount <= static_cast<int>(kWidth));
    if (box.grid.range_count == 1 && CountedInOneBrick<OneRange, T>::holds(box)) {
      const CountedInOneBrick<OneRange, T> counts(box, OneRange(box.grid));
      // a predictable branch; computing the mask from it would wait for the voxel in the middle
      if (flip)
        sum_slices<kCount, kWidth, true>(box, counts, 0, 0, kCount, sums);
      else
        sum_slices<kCount, kWidth>(box, counts, 0, 0, kCount, sums);
      return;
    }
  }
  if (box.grid.range_count == 1) {
    sum_rows<kCount>(box, OneRange(box.grid, flip), sums);
  } else {
    sum_unusual<kCount>(box, flip, sums);
  }
}

/// Dot product sum_i a(i) b(i), in four partial sums.
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
HWY_INLINE BoxPart part_inside(const LabelGrid<T>& grid, const AxisWeights (&axes)[3]) {
  BoxPart part;
  part.whole = true;
  for (int a = 0; a < 3; ++a) {
    const int start = axes[a].start, room = grid.dims[a] - start;
    part.begin[a] = start < 0 ? -start : 0;
    part.end[a] = room < axes[a].count ? room : axes[a].count;
    part.whole = part.whole && part.begin[a] == 0 && part.end[a] == axes[a].count;
  }
  return part;
}

template <int kCount, class T, class Kernel>
HWY_INLINE void sample_one(const LabelGrid<T>& grid, const Kernel& kernel, const SpherePoint& point,
                           double* sample) {
  // out of reach of all voxels, or NaN
  store_four(internal::HWY_NAMESPACE::all_four(0), sample);
  for (int a = 0; a < 3; ++a) {
    const double far = reach(kernel, a);
    if (!(point.x[a] > -far && point.x[a] < grid.dims[a] - 1 + far)) return;
  }

  AxisWeights axes[3];
  weigh(point, kernel, axes);
  const BoxPart part = part_inside(grid, axes);
  const auto nearest_to = [&](int a) HWY_ATTR { return static_cast<int>(nearest(point.x[a])); };
  const bool flip =
      part.whole && AnyRanges(grid).has(*grid.bricks.cell(nearest_to(0), nearest_to(1), nearest_to(2)));

  ColumnSums sums;
  const Box<T> box{grid, axes, part};
  sum_box<kCount>(box, flip, sums);

  // normalised last, in double, so that the divisions overlap with the sums
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
