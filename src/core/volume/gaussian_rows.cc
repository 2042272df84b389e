#include "palpate/volume/gaussian_rows.h"

#include "palpate/volume/simd_targets.h"

// Compiled once per target by foreach_target.h; HWY_DYNAMIC_DISPATCH selects a target at run time. Only
// functions marked HWY_INLINE and the four functions at the end are in the target's namespace, and they call
// no function of the standard library, so that no shared inline function is compiled for one target only.

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "volume/gaussian_rows.cc"
#include <hwy/foreach_target.h>
// after foreach_target.h
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace palpate::internal::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

// loads voxels as floats; two bytes are added as integers before the conversion, which is exact

template <class D>
HWY_INLINE hn::Vec<D> load(D d, const float* p) {
  return hn::LoadU(d, p);
}
template <class D>
HWY_INLINE hn::Vec<D> load(D d, const std::uint8_t* p) {
  const hn::Rebind<std::int32_t, D> di;
  const hn::Rebind<std::uint8_t, D> d8;
  return hn::ConvertTo(d, hn::PromoteTo(di, hn::LoadU(d8, p)));
}
template <class D>
HWY_INLINE hn::Vec<D> load_sum(D d, const float* a, const float* b) {
  return hn::Add(hn::LoadU(d, a), hn::LoadU(d, b));
}
template <class D>
HWY_INLINE hn::Vec<D> load_sum(D d, const std::uint8_t* a, const std::uint8_t* b) {
  const hn::Rebind<std::int32_t, D> di;
  const hn::Rebind<std::uint8_t, D> d8;
  return hn::ConvertTo(d, hn::Add(hn::PromoteTo(di, hn::LoadU(d8, a)), hn::PromoteTo(di, hn::LoadU(d8, b))));
}

template <class D>
HWY_INLINE void store(D d, hn::Vec<D> v, float* p) {
  hn::StoreU(v, d, p);
}
template <class D>
HWY_INLINE void store(D, hn::Vec<D> v, std::uint8_t* p) {
  const hn::Rebind<std::uint8_t, D> d8;
  hn::StoreU(hn::DemoteTo(d8, hn::NearestInt(v)), d8, p);
}
template <class D>
HWY_INLINE void store(D d, hn::Vec<D> v, std::uint16_t* p) {
  const hn::Rebind<std::uint16_t, D> d16;
  hn::StoreU(hn::DemoteTo(d16, hn::NearestInt(hn::Mul(v, hn::Set(d, 257.0f)))), d16, p);
}

template <class D, class T, class Out>
HWY_INLINE void sum_vector(D d, const WeightedRows<T>& rows, std::size_t x, Out* out) {
  auto sum = hn::Mul(hn::Set(d, rows.centre_weight), load(d, rows.centre + x));
  for (std::size_t t = 0; t < rows.pair_count; ++t) {
    const RowPair<T>& pair = rows.pairs[t];
    sum = hn::Add(sum, hn::Mul(hn::Set(d, pair.weight), load_sum(d, pair.before + x, pair.after + x)));
  }
  store(d, sum, out + x);
}

/// Same as sum_vector() for four adjacent vectors, which share the loop over the pairs.
template <class D, class T, class Out>
HWY_INLINE void sum_four_vectors(D d, const WeightedRows<T>& rows, std::size_t x, Out* out) {
  const std::size_t x1 = x + hn::Lanes(d), x2 = x1 + hn::Lanes(d), x3 = x2 + hn::Lanes(d);
  const auto w0 = hn::Set(d, rows.centre_weight);
  auto sum0 = hn::Mul(w0, load(d, rows.centre + x));
  auto sum1 = hn::Mul(w0, load(d, rows.centre + x1));
  auto sum2 = hn::Mul(w0, load(d, rows.centre + x2));
  auto sum3 = hn::Mul(w0, load(d, rows.centre + x3));
  for (std::size_t t = 0; t < rows.pair_count; ++t) {
    const T* a = rows.pairs[t].before;
    const T* b = rows.pairs[t].after;
    const auto w = hn::Set(d, rows.pairs[t].weight);
    sum0 = hn::Add(sum0, hn::Mul(w, load_sum(d, a + x, b + x)));
    sum1 = hn::Add(sum1, hn::Mul(w, load_sum(d, a + x1, b + x1)));
    sum2 = hn::Add(sum2, hn::Mul(w, load_sum(d, a + x2, b + x2)));
    sum3 = hn::Add(sum3, hn::Mul(w, load_sum(d, a + x3, b + x3)));
  }
  store(d, sum0, out + x);
  store(d, sum1, out + x1);
  store(d, sum2, out + x2);
  store(d, sum3, out + x3);
}

/// Weighted sum of a row of at least one vector. The last vector may overlap the previous one: it recomputes
/// the same values, and nothing is written beyond the row.
template <class D, class T, class Out>
HWY_INLINE void sum_by_vectors(D d, const WeightedRows<T>& rows, std::size_t length, Out* out) {
  const std::size_t lanes = hn::Lanes(d);
  std::size_t x = 0;
  for (; x + 4 * lanes <= length; x += 4 * lanes) sum_four_vectors(d, rows, x, out);
  for (; x + lanes <= length; x += lanes) sum_vector(d, rows, x, out);
  if (x < length) sum_vector(d, rows, length - lanes, out);
}

template <class T, class Out>
HWY_INLINE void sum(const WeightedRows<T>& rows, std::size_t length, Out* out) {
  const hn::ScalableTag<float> full;
  const hn::CappedTag<float, 1> single;
  if (length >= hn::Lanes(full)) {
    sum_by_vectors(full, rows, length, out);
  } else {
    sum_by_vectors(single, rows, length, out);
  }
}

void bytes_to_floats(const WeightedRows<std::uint8_t>& rows, std::size_t length, float* out) {
  sum(rows, length, out);
}
void floats_to_floats(const WeightedRows<float>& rows, std::size_t length, float* out) {
  sum(rows, length, out);
}
void floats_to_bytes(const WeightedRows<float>& rows, std::size_t length, std::uint8_t* out) {
  sum(rows, length, out);
}
void floats_to_words(const WeightedRows<float>& rows, std::size_t length, std::uint16_t* out) {
  sum(rows, length, out);
}

}  // namespace palpate::internal::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace palpate::internal {

HWY_EXPORT(bytes_to_floats);
HWY_EXPORT(floats_to_floats);
HWY_EXPORT(floats_to_bytes);
HWY_EXPORT(floats_to_words);

void sum_rows(const WeightedRows<std::uint8_t>& rows, std::size_t length, float* out) {
  HWY_DYNAMIC_DISPATCH(bytes_to_floats)(rows, length, out);
}
void sum_rows(const WeightedRows<float>& rows, std::size_t length, float* out) {
  HWY_DYNAMIC_DISPATCH(floats_to_floats)(rows, length, out);
}
void sum_rows(const WeightedRows<float>& rows, std::size_t length, std::uint8_t* out) {
  HWY_DYNAMIC_DISPATCH(floats_to_bytes)(rows, length, out);
}
void sum_rows(const WeightedRows<float>& rows, std::size_t length, std::uint16_t* out) {
  HWY_DYNAMIC_DISPATCH(floats_to_words)(rows, length, out);
}

}  // namespace palpate::internal

namespace palpate {

std::vector<std::string> simd_targets() {
  std::vector<std::string> names;
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    names.emplace_back(hwy::TargetName(target));
  }
  return names;
}

}  // namespace palpate
#endif  // HWY_ONCE
