#include "surfaces/signed_distance_rows.h"

// Compiled once per target by foreach_target.h, see gaussian_rows.cc.

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfaces/signed_distance_rows.cc"
#include <hwy/foreach_target.h>
// must follow foreach_target.h
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace palpate::internal::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

template <class D>
HWY_INLINE void min_vector(D d, const WeightedRows<float>& rows, std::size_t x, float* smallest) {
  auto now = hn::LoadU(d, rows.centre + x);
  for (std::size_t t = 0; t < rows.pair_count; ++t) {
    const RowPair<float>& pair = rows.pairs[t];
    const auto nearer = hn::Min(hn::LoadU(d, pair.before + x), hn::LoadU(d, pair.after + x));
    now = hn::Min(now, hn::Add(nearer, hn::Set(d, pair.weight)));
  }
  hn::StoreU(now, d, smallest + x);
}

/// Processes four adjacent vectors, whose dependency chains are independent.
template <class D>
HWY_INLINE void min_four_vectors(D d, const WeightedRows<float>& rows, std::size_t x, float* smallest) {
  const std::size_t x1 = x + hn::Lanes(d), x2 = x1 + hn::Lanes(d), x3 = x2 + hn::Lanes(d);
  auto now0 = hn::LoadU(d, rows.centre + x);
  auto now1 = hn::LoadU(d, rows.centre + x1);
  auto now2 = hn::LoadU(d, rows.centre + x2);
  auto now3 = hn::LoadU(d, rows.centre + x3);
  for (std::size_t t = 0; t < rows.pair_count; ++t) {
    const float* a = rows.pairs[t].before;
    const float* b = rows.pairs[t].after;
    const auto w = hn::Set(d, rows.pairs[t].weight);
    now0 = hn::Min(now0, hn::Add(hn::Min(hn::LoadU(d, a + x), hn::LoadU(d, b + x)), w));
    now1 = hn::Min(now1, hn::Add(hn::Min(hn::LoadU(d, a + x1), hn::LoadU(d, b + x1)), w));
    now2 = hn::Min(now2, hn::Add(hn::Min(hn::LoadU(d, a + x2), hn::LoadU(d, b + x2)), w));
    now3 = hn::Min(now3, hn::Add(hn::Min(hn::LoadU(d, a + x3), hn::LoadU(d, b + x3)), w));
  }
  hn::StoreU(now0, d, smallest + x);
  hn::StoreU(now1, d, smallest + x1);
  hn::StoreU(now2, d, smallest + x2);
  hn::StoreU(now3, d, smallest + x3);
}

/// The last vector may overlap the one before it, computing the same values again.
template <class D>
HWY_INLINE void min_by_vectors(D d, const WeightedRows<float>& rows, std::size_t length, float* smallest) {
  const std::size_t lanes = hn::Lanes(d);
  std::size_t x = 0;
  for (; x + 4 * lanes <= length; x += 4 * lanes) min_four_vectors(d, rows, x, smallest);
  for (; x + lanes <= length; x += lanes) min_vector(d, rows, x, smallest);
  if (x < length) min_vector(d, rows, length - lanes, smallest);
}

void least(const WeightedRows<float>& rows, std::size_t length, float* out) {
  const hn::ScalableTag<float> full;
  const hn::CappedTag<float, 1> single;
  if (length >= hn::Lanes(full)) {
    min_by_vectors(full, rows, length, out);
  } else {
    min_by_vectors(single, rows, length, out);
  }
}

}  // namespace palpate::internal::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace palpate::internal {

HWY_EXPORT(least);

void min_of_rows(const WeightedRows<float>& rows, std::size_t length, float* out) {
  HWY_DYNAMIC_DISPATCH(least)(rows, length, out);
}

}  // namespace palpate::internal
#endif  // HWY_ONCE
