// Membership tests of voxels, and the gradient's transform to a sample, for label_sphere_simd.cc. Included
// once per target.
#include "sampling/label_sphere_simd.h"
#include "sampling/vectors-inl.h"

#if defined(PALPATE_SAMPLING_LABEL_MEMBERS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef PALPATE_SAMPLING_LABEL_MEMBERS_INL_H_
#undef PALPATE_SAMPLING_LABEL_MEMBERS_INL_H_
#else
#define PALPATE_SAMPLING_LABEL_MEMBERS_INL_H_
#endif

#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace palpate::internal::label_sphere::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

HWY_INLINE std::uint32_t first_to_last(const LabelRange& range) {
  return static_cast<std::uint32_t>(range.last - range.first);
}

/// Whether each lane is one of the `span` + 1 labels from `first` on; lanes have the width of the stored
/// type.
template <class D>
HWY_INLINE hn::Mask<D> is_in(D d, hn::Vec<D> label, std::uint32_t first, std::uint32_t span) {
  using T = hn::TFromD<D>;
  const auto above = hn::Sub(label, hn::Set(d, static_cast<T>(first)));
  return hn::Eq(hn::Min(above, hn::Set(d, static_cast<T>(span))), above);
}

/// Membership in one range of consecutive labels, the common case.
struct OneRange {
  /// @param flip  test for non-members instead: the complementary range, with wrap-around
  template <class T>
  HWY_INLINE explicit OneRange(const LabelGrid<T>& grid, bool flip = false)
      : first(flip ? grid.ranges[0].last + 1u : grid.ranges[0].first), span(first_to_last(grid.ranges[0])) {
    constexpr std::uint32_t kMaxIndex = static_cast<T>(~T{0});
    if (flip) span = kMaxIndex - 1 - span;
  }
  template <class DU>
  HWY_INLINE hn::Mask<DU> miss(DU du, hn::Vec<DU> label) const {
    return hn::Gt(hn::Sub(label, hn::Set(du, first)), hn::Set(du, span));
  }
  template <class D>
  HWY_INLINE hn::Mask<D> hit(D d, hn::Vec<D> label) const {
    return is_in(d, label, first, span);
  }
  HWY_INLINE bool has(std::uint32_t label) const { return label - first <= span; }
  std::uint32_t first, span;
};

struct AnyRanges {
  template <class T>
  HWY_INLINE explicit AnyRanges(const LabelGrid<T>& grid, bool flip_hits = false)
      : ranges(grid.ranges), count(grid.range_count), flip(flip_hits) {}
  template <class DU>
  HWY_INLINE hn::Mask<DU> miss(DU du, hn::Vec<DU> label) const {
    // no label has 32 bits, so initially all lanes miss
    auto all = hn::Ne(label, hn::Set(du, ~std::uint32_t{0}));
    for (std::size_t n = 0; n < count; ++n) {
      const auto above = hn::Sub(label, hn::Set(du, std::uint32_t{ranges[n].first}));
      all = hn::And(all, hn::Gt(above, hn::Set(du, first_to_last(ranges[n]))));
    }
    return all;
  }
  template <class D>
  HWY_INLINE hn::Mask<D> hit(D d, hn::Vec<D> label) const {
    using T = hn::TFromD<D>;
    auto any = hn::Ne(hn::Set(d, static_cast<T>(flip ? 1 : 0)), hn::Zero(d));
    for (std::size_t n = 0; n < count; ++n)
      any = hn::Xor(any, is_in(d, label, ranges[n].first, first_to_last(ranges[n])));
    return any;
  }
  HWY_INLINE bool has(std::uint32_t label) const {
    for (std::size_t n = 0; n < count; ++n) {
      if (label >= ranges[n].first && label <= ranges[n].last) return true;
    }
    return false;
  }
  const LabelRange* ranges;
  std::size_t count;
  bool flip;  ///< inverts hit()
};

/// Contribution of a derivative along grid axis a to a sample (value and gradient per mm).
template <class T>
HWY_INLINE internal::HWY_NAMESPACE::Quad gradient_column(const LabelGrid<T>& grid, int a) {
  const double* m = grid.voxel_per_mm + a;
  return internal::HWY_NAMESPACE::of_four(0, m[0], m[3], m[6]);
}

}  // namespace palpate::internal::label_sphere::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // per target
