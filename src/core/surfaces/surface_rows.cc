#include "surfaces/surface_rows.h"

#include "palpate/surfaces/surfaces.h"

// Compiled once per target by foreach_target.h, see gaussian_rows.cc.

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfaces/surface_rows.cc"
#include <hwy/foreach_target.h>
// must follow foreach_target.h
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace palpate::internal::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// Calls body(tag, x) for vectors of a row; the last one may overlap the one before it.
template <class Body>
HWY_INLINE void by_vectors(std::size_t length, const Body& body) {
  const hn::ScalableTag<float> full;
  const std::size_t lanes = hn::Lanes(full);
  if (length < lanes) {
    for (std::size_t x = 0; x < length; ++x) body(hn::CappedTag<float, 1>(), x);
    return;
  }
  std::size_t x = 0;
  for (; x + lanes <= length; x += lanes) body(full, x);
  if (x < length) body(full, length - lanes);
}

template <class D>
HWY_INLINE hn::Vec<D> load_steps(D d, const std::int16_t* p) {
  const hn::Rebind<std::int16_t, D> d16;
  const hn::Rebind<std::int32_t, D> d32;
  return hn::ConvertTo(d, hn::PromoteTo(d32, hn::LoadU(d16, p)));
}
template <class D, class V>
HWY_INLINE void store_steps(D /*d*/, V steps, std::int16_t* p) {
  const hn::Rebind<std::int16_t, D> d16;
  hn::StoreU(hn::DemoteTo(d16, hn::NearestInt(steps)), d16, p);
}

void to_mm(const std::int16_t* steps, std::size_t length, float limit_mm, float* mm) {
  by_vectors(length, [=](auto d, std::size_t x) HWY_ATTR {
    const auto value = hn::Mul(load_steps(d, steps + x), hn::Set(d, static_cast<float>(kSurfaceStep_mm)));
    hn::StoreU(hn::Max(hn::Set(d, -limit_mm), hn::Min(hn::Set(d, limit_mm), value)), d, mm + x);
  });
}

void to_stored(const float* mm, std::size_t length, std::int16_t* steps) {
  by_vectors(length, [=](auto d, std::size_t x) HWY_ATTR {
    store_steps(d, hn::Mul(hn::LoadU(d, mm + x), hn::Set(d, static_cast<float>(1 / kSurfaceStep_mm))),
                steps + x);
  });
}

/// Copies every second value; returns the number copied, which leaves less than a vector.
std::size_t sample_evenly(const std::int16_t* from, std::size_t count, std::int16_t* taken) {
  const hn::ScalableTag<std::int16_t> d;
  const std::size_t lanes = hn::Lanes(d);
  std::size_t n = 0;
  // strictly less, because the last pair is loaded completely
  for (; n + lanes < count; n += lanes) {
    hn::Vec<decltype(d)> even, odd;
    hn::LoadInterleaved2(d, from + 2 * n, even, odd);
    hn::StoreU(even, d, taken + n);
  }
  return n;
}

bool equal(const float* row, std::size_t length) {
  bool same = true;
  const float first = row[0];
  by_vectors(length, [&](auto d, std::size_t x) HWY_ATTR {
    if (same) same = hn::AllTrue(d, hn::Eq(hn::LoadU(d, row + x), hn::Set(d, first)));
  });
  return same;
}

void roots(const std::uint8_t* mask, std::uint8_t mine, const float* squared, std::size_t length,
           float* distance) {
  const float sign = mine != 0 ? -1.0f : 1.0f;
  by_vectors(length, [=](auto d, std::size_t x) HWY_ATTR {
    const hn::Rebind<std::uint8_t, decltype(d)> d8;
    const hn::Rebind<std::int32_t, decltype(d)> d32;
    const auto m = hn::ConvertTo(d, hn::PromoteTo(d32, hn::LoadU(d8, mask + x)));
    const auto root = hn::Mul(hn::Set(d, sign), hn::Sqrt(hn::LoadU(d, squared + x)));
    const auto here = hn::Eq(m, hn::Set(d, static_cast<float>(mine)));
    hn::StoreU(hn::IfThenElse(here, root, hn::LoadU(d, distance + x)), d, distance + x);
  });
}

/// `value`, negated where `side` is negative.
template <class D, class V>
HWY_INLINE V on_side_of(D d, V value, V side) {
  const auto zero = hn::Zero(d);
  return hn::IfThenElse(hn::Lt(side, zero), hn::Sub(zero, value), value);
}

bool wrong(const float* distance, const float* smooth, float clamp_fraction, std::size_t length, float* out) {
  bool any = false;
  by_vectors(length, [&](auto d, std::size_t x) HWY_ATTR {
    const auto far = hn::LoadU(d, distance + x);
    const auto part = hn::Div(on_side_of(d, hn::LoadU(d, smooth + x), far),
                              hn::Mul(hn::Set(d, clamp_fraction), hn::Abs(far)));
    const auto zero = hn::Zero(d);
    const auto value = hn::Max(hn::Set(d, -1.0f), hn::Min(zero, part));
    any = any || !hn::AllFalse(d, hn::Lt(value, zero));
    hn::StoreU(value, d, out + x);
  });
  return any;
}

void hold(const PositionRows& rows, float clamp_fraction, std::size_t length, std::int16_t* position) {
  by_vectors(length, [&](auto d, std::size_t x) HWY_ATTR {
    const auto distance = hn::LoadU(d, rows.distance + x);
    const auto far = hn::Abs(distance);
    const auto own = hn::Min(on_side_of(d, hn::LoadU(d, rows.smooth + x), distance), far);
    const auto clamped = hn::Max(own, hn::Mul(hn::Set(d, clamp_fraction), far));
    const auto preserve = hn::Neg(hn::Min(hn::LoadU(d, rows.preserve + x), hn::LoadU(d, rows.wrong + x)));
    const auto held = hn::Add(own, hn::Mul(preserve, hn::Sub(clamped, own)));
    // no voxel lies exactly on the surface: its sign is the label
    const auto one = hn::Set(d, 1.0f);
    const auto steps = hn::Max(one, hn::Mul(held, hn::Set(d, static_cast<float>(1 / kSurfaceStep_mm))));
    store_steps(d, on_side_of(d, steps, distance), position + x);
  });
}

void weigh(const float* position, const float* broad, const SurfaceBand& band, std::size_t length,
           float* weight, float* weighted) {
  by_vectors(length, [=](auto d, std::size_t x) HWY_ATTR {
    const auto p = hn::LoadU(d, position + x);
    const auto near = hn::Div(hn::Abs(p), hn::Set(d, band.band_mm));
    const auto w = hn::Max(hn::Zero(d), hn::Sub(hn::Set(d, 1.0f), near));
    const auto height = hn::Sub(hn::LoadU(d, broad + x), hn::Mul(hn::Set(d, band.slope), p));
    hn::StoreU(w, d, weight + x);
    hn::StoreU(hn::Mul(w, height), d, weighted + x);
  });
}

void blend(const NormalRows& rows, const PositionFraction& fraction, std::size_t length,
           std::int16_t* normal) {
  by_vectors(length, [&](auto d, std::size_t x) HWY_ATTR {
    const auto zero = hn::Zero(d), one = hn::Set(d, 1.0f), low = hn::Set(d, fraction.low_mm);
    // a lower bound of the weight avoids noise: the height becomes nearly 0
    const auto surface = hn::Max(hn::LoadU(d, rows.surface + x), hn::Set(d, 1e-6f));
    const auto height = hn::Div(hn::LoadU(d, rows.height_sum + x), surface);
    const auto high = hn::Abs(height);
    const auto above = hn::Div(hn::Sub(high, low), hn::Set(d, fraction.high_mm - fraction.low_mm));
    const auto part = hn::Mul(hn::Set(d, fraction.most), hn::Max(zero, hn::Min(one, above)));
    const auto rest = hn::Sub(one, part);

    // position, bent to match the broad distance over a plane
    const auto position = hn::Mul(hn::LoadU(d, rows.position + x), hn::Set(d, fraction.slope));
    const auto of_limit = hn::Div(position, hn::Set(d, fraction.limit_mm));
    const auto square = hn::Mul(of_limit, of_limit);
    const auto bent = hn::Div(position, hn::Sqrt(hn::Sqrt(hn::Add(one, hn::Mul(square, square)))));

    // shift that levels the surface where its height exceeds low_mm
    const auto raise = hn::IfThenElse(hn::Gt(high, low), hn::Sub(low, hn::Mul(rest, high)), zero);
    const auto shift = on_side_of(d, raise, height);
    const auto blended = hn::Add(hn::Mul(rest, hn::LoadU(d, rows.broad + x)), hn::Mul(part, bent));
    const auto mm = hn::Add(blended, shift);
    store_steps(d, hn::Mul(mm, hn::Set(d, static_cast<float>(1 / kSurfaceStep_mm))), normal + x);
  });
}

float max_gradient(const CellRows& rows, std::size_t cells) {
  float worst = 0;
  by_vectors(cells, [&](auto d, std::size_t x) HWY_ATTR {
    const auto v00 = load_steps(d, rows.row[0] + x), v10 = load_steps(d, rows.row[1] + x);
    const auto v01 = load_steps(d, rows.row[2] + x), v11 = load_steps(d, rows.row[3] + x);
    const auto w00 = load_steps(d, rows.row[0] + x + 1), w10 = load_steps(d, rows.row[1] + x + 1);
    const auto w01 = load_steps(d, rows.row[2] + x + 1), w11 = load_steps(d, rows.row[3] + x + 1);
    const auto most = [](auto a, auto b, auto c, auto e) HWY_ATTR {
      return hn::Max(hn::Max(hn::Abs(a), hn::Abs(b)), hn::Max(hn::Abs(c), hn::Abs(e)));
    };
    const auto along_i = most(hn::Sub(w00, v00), hn::Sub(w10, v10), hn::Sub(w01, v01), hn::Sub(w11, v11));
    const auto along_j = most(hn::Sub(v10, v00), hn::Sub(v11, v01), hn::Sub(w10, w00), hn::Sub(w11, w01));
    const auto along_k = most(hn::Sub(v01, v00), hn::Sub(v11, v10), hn::Sub(w01, w00), hn::Sub(w11, w10));
    const auto gi = hn::Mul(along_i, hn::Set(d, rows.per_step[0]));
    const auto gj = hn::Mul(along_j, hn::Set(d, rows.per_step[1]));
    const auto gk = hn::Mul(along_k, hn::Set(d, rows.per_step[2]));
    const auto square = hn::Add(hn::Add(hn::Mul(gi, gi), hn::Mul(gj, gj)), hn::Mul(gk, gk));
    const float max_here = hn::GetLane(hn::MaxOfLanes(d, square));
    worst = worst < max_here ? max_here : worst;
  });
  return worst;
}

}  // namespace palpate::internal::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace palpate::internal {

HWY_EXPORT(to_mm);
HWY_EXPORT(to_stored);
HWY_EXPORT(sample_evenly);
HWY_EXPORT(equal);
HWY_EXPORT(roots);
HWY_EXPORT(wrong);
HWY_EXPORT(hold);
HWY_EXPORT(weigh);
HWY_EXPORT(blend);
HWY_EXPORT(max_gradient);

void steps_to_mm(const std::int16_t* steps, std::size_t length, float limit_mm, float* mm) {
  HWY_DYNAMIC_DISPATCH(to_mm)(steps, length, limit_mm, mm);
}
void mm_to_steps(const float* mm, std::size_t length, std::int16_t* steps) {
  HWY_DYNAMIC_DISPATCH(to_stored)(mm, length, steps);
}
void take_every(const std::int16_t* from, std::size_t step, std::size_t count, std::int16_t* taken) {
  std::size_t n = step == 2 ? HWY_DYNAMIC_DISPATCH(sample_evenly)(from, count, taken) : 0;
  for (; n < count; ++n) taken[n] = from[n * step];
}
bool all_equal(const float* row, std::size_t length) {
  return HWY_DYNAMIC_DISPATCH(equal)(row, length);
}
void roots_where(const std::uint8_t* mask, std::uint8_t mine, const float* squared, std::size_t length,
                 float* distance) {
  HWY_DYNAMIC_DISPATCH(roots)(mask, mine, squared, length, distance);
}
bool wrong_side(const float* distance, const float* smooth, float clamp_fraction, std::size_t length,
                float* out) {
  return HWY_DYNAMIC_DISPATCH(wrong)(distance, smooth, clamp_fraction, length, out);
}
void hold_position(const PositionRows& rows, float clamp_fraction, std::size_t length,
                   std::int16_t* position) {
  HWY_DYNAMIC_DISPATCH(hold)(rows, clamp_fraction, length, position);
}
void weigh_by_position(const float* position, const float* broad, const SurfaceBand& band, std::size_t length,
                       float* weight, float* weighted) {
  HWY_DYNAMIC_DISPATCH(weigh)(position, broad, band, length, weight, weighted);
}
void blend_with_position(const NormalRows& rows, const PositionFraction& fraction, std::size_t length,
                         std::int16_t* normal) {
  HWY_DYNAMIC_DISPATCH(blend)(rows, fraction, length, normal);
}
float steepest_square(const CellRows& rows, std::size_t cells) {
  return HWY_DYNAMIC_DISPATCH(max_gradient)(rows, cells);
}

}  // namespace palpate::internal
#endif  // HWY_ONCE
