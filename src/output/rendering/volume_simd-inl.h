// Vectors of one chunk of pixels, and the lit blocks that lines and rays sample. Included once per target,
// after hwy/foreach_target.h. No fused operations are used: bit-identical on every target.

#include <hwy/highway.h>

#include <cstddef>
#include <cstdint>

#include "rendering/volume_simd.h"

#if defined(PALPATE_RENDERING_VOLUME_SIMD_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef PALPATE_RENDERING_VOLUME_SIMD_INL
#undef PALPATE_RENDERING_VOLUME_SIMD_INL
#else
#define PALPATE_RENDERING_VOLUME_SIMD_INL
#endif

HWY_BEFORE_NAMESPACE();
namespace palpate::internal::volume_picture::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

using DF = hn::CappedTag<float, kChunk>;
using DI = hn::RebindToSigned<DF>;
using D16 = hn::Rebind<std::uint16_t, DF>;
using D8 = hn::Rebind<std::uint8_t, DF>;
using VF = hn::Vec<DF>;
using VI = hn::Vec<DI>;
using DU = hn::RebindToUnsigned<DI>;
using VU = hn::Vec<DU>;

HWY_INLINE int lanes() {
  return static_cast<int>(hn::Lanes(DF()));
}
static_assert(kChunk == kBlock);

/// Transmittance below which a pixel counts as opaque.
constexpr float kDone = 1.0f / 400;
constexpr float kTiny = 1e-7f;

HWY_INLINE VF load_bytes(const std::uint8_t* from) {
  return hn::ConvertTo(DF(), hn::PromoteTo(DI(), hn::LoadU(D8(), from)));
}
HWY_INLINE VF load_bytes(const std::int8_t* from) {
  const hn::Rebind<std::int8_t, DF> d;
  return hn::ConvertTo(DF(), hn::PromoteTo(DI(), hn::LoadU(d, from)));
}
HWY_INLINE void store_pair(VI lower, VI upper, std::uint32_t* to) {
  hn::StoreU(hn::BitCast(DU(), hn::Or(lower, hn::ShiftLeft<16>(upper))), DU(), to);
}
HWY_INLINE VF lower_of(VU pair) {
  return hn::ConvertTo(DF(), hn::BitCast(DI(), hn::And(pair, hn::Set(DU(), 0xffff))));
}
HWY_INLINE VF upper_of(VU pair) {
  return hn::ConvertTo(DF(), hn::BitCast(DI(), hn::ShiftRight<16>(pair)));
}

HWY_INLINE void light_block(const VoxelBlock& from, const Illumination& light, LitBlock& to) {
  const DF d;
  const DI di;
  const auto one = hn::Set(d, 1.0f), half = hn::Set(d, 0.5f), most = hn::Set(d, 65535.0f);
  const auto per_step = hn::Set(d, 1 / kNormalSteps), per_colour = hn::Set(d, 1.0f / 255);
  for (int n = 0; n < kBlock; n += lanes()) {
    const VF x = hn::Mul(load_bytes(from.normal[0] + n), per_step);
    const VF y = hn::Mul(load_bytes(from.normal[1] + n), per_step);
    const VF z = hn::Mul(load_bytes(from.normal[2] + n), per_step);
    const VF square = hn::Add(hn::Mul(x, x), hn::Add(hn::Mul(y, y), hn::Mul(z, z)));
    const VF length = hn::Min(hn::Sqrt(square), one);
    const VF along =
        hn::Add(hn::Mul(x, hn::Set(d, light.into[0])),
                hn::Add(hn::Mul(y, hn::Set(d, light.into[1])), hn::Mul(z, hn::Set(d, light.into[2]))));
    const VF facing = hn::Min(hn::Add(hn::Abs(along), hn::Sub(one, length)), one);
    const VF f2 = hn::Mul(facing, facing), f4 = hn::Mul(f2, f2),
             f16 = hn::Mul(hn::Mul(f4, f4), hn::Mul(f4, f4));
    const VF gloss = hn::Mul(hn::Set(d, light.specular), hn::Mul(f16, f4));
    const VF from_key = hn::Add(
        hn::Mul(x, hn::Set(d, light.from_key[0])),
        hn::Add(hn::Mul(y, hn::Set(d, light.from_key[1])), hn::Mul(z, hn::Set(d, light.from_key[2]))));
    const VF lit = hn::Min(
        hn::Add(hn::Max(from_key, hn::Zero(d)), hn::Mul(hn::Set(d, light.key_facing), hn::Sub(one, length))),
        one);
    const VF dull = hn::Add(hn::Add(hn::Set(d, light.ambient), hn::Mul(hn::Set(d, light.diffuse), facing)),
                            hn::Mul(hn::Set(d, light.key), lit));
    const VI steps = hn::PromoteTo(di, hn::LoadU(D16(), from.extinction + n));
    const VF extinction = hn::ConvertTo(d, steps);
    const auto lit_by = [&](const std::uint8_t* colours) HWY_ATTR {
      const VF colour = hn::Mul(load_bytes(colours + n), per_colour);
      const VF value = hn::Mul(extinction, hn::Add(hn::Mul(colour, dull), gloss));
      return hn::ConvertTo(di, hn::Add(hn::Min(value, most), half));
    };
    store_pair(lit_by(from.colour[0]), lit_by(from.colour[1]), to.pair[0] + n);
    store_pair(lit_by(from.colour[2]), steps, to.pair[1] + n);
  }
}

inline HWY_NOINLINE void light_now(const RowsView& rows, std::uint32_t index, LitBlockCache& lit) {
  const std::uint32_t slot = index % LitBlockCache::kCount;
  light_block(rows.voxels[index], rows.light, lit.lit[slot]);
  lit.index[slot] = index;
}

HWY_INLINE bool is_lit(std::uint32_t index, const LitBlockCache& lit) {
  return lit.index[index % LitBlockCache::kCount] == index;
}

/// Returns a lit block, valid until the next call.
HWY_INLINE const LitBlock& lit_block(const RowsView& rows, std::uint32_t index, LitBlockCache& lit) {
  const std::uint32_t slot = index % LitBlockCache::kCount;
  if (HWY_UNLIKELY(!is_lit(index, lit))) light_now(rows, index, lit);
  return lit.lit[slot];
}

/// Prefetches a block, in its lit or unlit form. Selected without a branch, which would often be
/// mispredicted.
HWY_INLINE void prefetch_block(const RowsView& rows, std::uint32_t index, const LitBlockCache& lit) {
  const std::uint32_t slot = index % LitBlockCache::kCount;
  const auto there = reinterpret_cast<std::uintptr_t>(&lit.lit[slot]),
             far = reinterpret_cast<std::uintptr_t>(&rows.voxels[index]),
             is_there = std::uintptr_t{0} - static_cast<std::uintptr_t>(lit.index[slot] == index);
  __builtin_prefetch(reinterpret_cast<const void*>((there & is_there) | (far & ~is_there)));
}

/// Block of a row that contains voxel x; may be negative.
HWY_INLINE int block_of_voxel(int x) {
  return x >= 0 ? x / kBlock : -1 - (-x - 1) / kBlock;
}

}  // namespace palpate::internal::volume_picture::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
