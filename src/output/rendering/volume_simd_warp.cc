// The warp from intermediate pixels to pixels of the picture, and the detection of edges between intermediate
// pixels.

#include <cmath>
#include <cstring>

#include "rendering/volume_simd.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "rendering/volume_simd_warp.cc"
#include <hwy/foreach_target.h>
// after foreach_target.h
#include <hwy/highway.h>

#include "rendering/volume_simd-inl.h"

HWY_BEFORE_NAMESPACE();
namespace palpate::internal::volume_picture::HWY_NAMESPACE {

/// An edge lies between two intermediate pixels if the second difference of radiance, of 1023, exceeds this
/// at both. A linear gradient has none; a crease exceeds it at both, by more than the error of the
/// interpolation.
constexpr std::int32_t kCreaseThreshold = 50;
/// An edge also lies between four pixels that differ by more than this if the second difference is large at
/// one of them.
constexpr float kApart = 50;

HWY_INLINE VF channel_of(VI word, int which) {
  const DI di;
  const VI shifted = which == 0 ? hn::ShiftRight<20>(word) : which == 1 ? hn::ShiftRight<10>(word) : word;
  return hn::ConvertTo(DF(), hn::And(shifted, hn::Set(di, 1023)));
}

void mark_line(const std::uint32_t* above, const std::uint32_t* here, const std::uint32_t* below, int width,
               std::uint32_t* marked) {
  const DI di;
  const auto channel = [&](VI word, int which) HWY_ATTR {
    const VI shifted = which == 0 ? hn::ShiftRight<20>(word) : which == 1 ? hn::ShiftRight<10>(word) : word;
    return hn::And(shifted, hn::Set(di, 1023));
  };
  const auto load = [&](const std::uint32_t* from)
                        HWY_ATTR { return hn::BitCast(di, hn::LoadU(DU(), from)); };
  for (int u = 0; u < (width + kChunk - 1) / kChunk * kChunk; u += lanes()) {
    const VI middle = load(here + u), before = load(here + u - 1), after = load(here + u + 1),
             upper = load(above + u), lower = load(below + u);
    VI along = hn::Zero(di), across = along;
    for (int c = 0; c < 3; ++c) {
      const VI twice = hn::ShiftLeft<1>(channel(middle, c));
      along = hn::Max(along, hn::Abs(hn::Sub(hn::Add(channel(before, c), channel(after, c)), twice)));
      across = hn::Max(across, hn::Abs(hn::Sub(hn::Add(channel(upper, c), channel(lower, c)), twice)));
    }
    const auto marks = [&](VI bend, std::uint32_t bit) HWY_ATTR {
      return hn::And(hn::VecFromMask(di, hn::Gt(bend, hn::Set(di, kCreaseThreshold))),
                     hn::Set(di, static_cast<std::int32_t>(bit)));
    };
    const VI word = hn::Or(middle, hn::Or(marks(along, kCreaseAlong), marks(across, kCreaseAcross)));
    hn::StoreU(hn::BitCast(DU(), word), DU(), marked + u);
  }
}

int warp_row(const Warp& warp, int begin, int end, std::uint8_t* rgb, std::int32_t* edges) {
  const DF d;
  const DI di;
  int edge_count = 0;
  const auto* pixels = reinterpret_cast<const std::int32_t*>(warp.pixels);
  const VI stride = hn::Set(di, static_cast<std::int32_t>(warp.stride)), one = hn::Set(di, 1);
  const VF max_u = hn::Set(d, static_cast<float>(warp.width - 1) - 1e-3f),
           max_v = hn::Set(d, static_cast<float>(warp.height - 1) - 1e-3f);
  for (int x = begin; x < end; x += lanes()) {
    const VF number = hn::Iota(d, 0.0f);
    const auto linear = [&](double start, double step) HWY_ATTR {
      return hn::Add(hn::Set(d, static_cast<float>(start + step * x)),
                     hn::Mul(number, hn::Set(d, static_cast<float>(step))));
    };
    const VF w = linear(warp.w_0, warp.w_step);
    const VF u = hn::Min(hn::Max(hn::Div(linear(warp.u_0, warp.u_step), w), hn::Zero(d)), max_u);
    const VF v = hn::Min(hn::Max(hn::Div(linear(warp.v_0, warp.v_step), w), hn::Zero(d)), max_v);
    const VI column = hn::ConvertTo(di, u), row = hn::ConvertTo(di, v);
    const VF fu = hn::Sub(u, hn::ConvertTo(d, column)), fv = hn::Sub(v, hn::ConvertTo(d, row));
    const VI at = hn::Add(column, hn::Mul(row, stride));
    const VI a = hn::GatherIndex(di, pixels, at), b = hn::GatherIndex(di, pixels, hn::Add(at, one)),
             e = hn::GatherIndex(di, pixels, hn::Add(at, stride)),
             f = hn::GatherIndex(di, pixels, hn::Add(hn::Add(at, stride), one));
    const int count = end - x < lanes() ? end - x : lanes();
    // usually more than half of a picture is uniform background, without differences and edges
    const auto word = static_cast<std::uint32_t>(hn::GetLane(a));
    const VI same = hn::Set(di, hn::GetLane(a));
    const VI differ_from =
        hn::Or(hn::Or(hn::Xor(a, same), hn::Xor(b, same)), hn::Or(hn::Xor(e, same), hn::Xor(f, same)));
    if ((word & (kCreaseAlong | kCreaseAcross)) == 0 && hn::AllTrue(di, hn::Eq(differ_from, hn::Zero(di)))) {
      for (int c = 0; c < 3; ++c) {
        const auto level = static_cast<std::uint8_t>(
            static_cast<float>(word >> (20 - 10 * c) & 1023) * (255.0f / 1023) + 0.5f);
        for (int n = 0; n < count; ++n) rgb[3 * (x + n) + c] = level;
      }
      continue;
    }
    HWY_ALIGN std::uint8_t bytes[3][kChunk];
    VF apart = hn::Zero(d);
    for (int c = 0; c < 3; ++c) {
      const VF pa = channel_of(a, c), pb = channel_of(b, c), pe = channel_of(e, c), pf = channel_of(f, c);
      const VF upper = hn::Add(pa, hn::Mul(fu, hn::Sub(pb, pa))),
               lower = hn::Add(pe, hn::Mul(fu, hn::Sub(pf, pe)));
      const VF value = hn::Add(upper, hn::Mul(fv, hn::Sub(lower, upper)));
      apart = hn::Max(apart, hn::Sub(hn::Max(hn::Max(pa, pb), hn::Max(pe, pf)),
                                     hn::Min(hn::Min(pa, pb), hn::Min(pe, pf))));
      const VF level = hn::Add(hn::Mul(value, hn::Set(d, 255.0f / 1023)), hn::Set(d, 0.5f));
      hn::StoreU(hn::DemoteTo(D8(), hn::ConvertTo(di, level)), D8(), bytes[c]);
    }
    for (int n = 0; n < count; ++n)
      for (int c = 0; c < 3; ++c) rgb[3 * (x + n) + c] = bytes[c][n];
    // marks of the four pixels, in the most significant bit
    const auto either = [&](VI along, VI across) HWY_ATTR { return hn::Or(along, hn::ShiftLeft<1>(across)); };
    const VI any = hn::Or(hn::Or(a, b), hn::Or(e, f));
    const VI bends = either(hn::Or(hn::And(a, b), hn::And(e, f)), hn::Or(hn::And(a, e), hn::And(b, f)));
    const VI differ = hn::VecFromMask(di, hn::RebindMask(di, hn::Gt(apart, hn::Set(d, kApart))));
    const VI marks = hn::Or(bends, hn::And(either(any, any), differ));
    if (hn::AllFalse(di, hn::Lt(marks, hn::Zero(di)))) continue;
    HWY_ALIGN std::int32_t marked[kChunk];
    hn::Store(marks, di, marked);
    for (int n = 0; n < count; ++n)
      if (marked[n] < 0) edges[edge_count++] = x + n;
  }
  return edge_count;
}

}  // namespace palpate::internal::volume_picture::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace palpate::internal::volume_picture {

HWY_EXPORT(mark_line);
HWY_EXPORT(warp_row);

int warp_row(const Warp& warp, int begin, int end, std::uint8_t* rgb, std::int32_t* edges) {
  return HWY_DYNAMIC_DISPATCH(warp_row)(warp, begin, end, rgb, edges);
}
void mark_line(const std::uint32_t* above, const std::uint32_t* here, const std::uint32_t* below, int width,
               std::uint32_t* marked) {
  HWY_DYNAMIC_DISPATCH(mark_line)(above, here, below, width, marked);
}

}  // namespace palpate::internal::volume_picture
#endif  // HWY_ONCE
