#include "rendering/volume_simd.h"

// Neighbouring lines of intermediate pixels are accumulated over the sampling planes together. On each plane:
//
//     blocks   runs of stored blocks in the voxel rows around the lines, by bit operations
//     pixels   chunks of a run in which some pixel is not opaque yet
//     rows     the two voxel rows before and behind the plane are mixed to one, in float
//     samples  interpolation between the two mixed rows around the line, with constant weights, and between
//              two voxels along it; accumulation
//
// These are separate functions that are not inlined: a single body would exceed the registers, and takes a
// tenth longer. No fused operations are used: bit-identical on every target. Compiled once per target by
// foreach_target.h.

#include <cmath>
#include <cstring>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "rendering/volume_simd.cc"
#include <hwy/foreach_target.h>
// after foreach_target.h
#include <hwy/highway.h>

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
/// An edge lies between two intermediate pixels if the second difference of radiance, of 1023, exceeds this
/// at both. A linear gradient has none; a crease exceeds it at both, by more than the error of the
/// interpolation.
constexpr std::int32_t kCreaseThreshold = 50;
/// An edge also lies between four pixels that differ by more than this if the second difference is large at
/// one of them.
constexpr float kApart = 50;

// ---- light ------------------------------------------------------------------------------------------------

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

HWY_NOINLINE void light_now(const RowsView& rows, std::uint32_t index, LitBlockCache& lit) {
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

// ---- a line -----------------------------------------------------------------------------------------------

/// e^-t for t >= 0, to 1e-4: sixteenth power of a truncated series.
template <class D, class V = hn::Vec<D>>
HWY_INLINE V exp_of_minus(D d, V t) {
  const V y = hn::Min(hn::Mul(t, hn::Set(d, 1.0f / 16)), hn::Set(d, 1.0f));
  V p = hn::Set(d, 1.0f / 24);
  p = hn::Sub(hn::Set(d, 1.0f / 6), hn::Mul(y, p));
  p = hn::Sub(hn::Set(d, 0.5f), hn::Mul(y, p));
  p = hn::Sub(hn::Set(d, 1.0f), hn::Mul(y, p));
  p = hn::Sub(hn::Set(d, 1.0f), hn::Mul(y, p));
  p = hn::Mul(p, p);
  p = hn::Mul(p, p);
  p = hn::Mul(p, p);
  return hn::Mul(p, p);
}

/// The voxel rows before and behind a plane, at one position across them; only those with a non-zero weight.
struct RowPair {
  int count = 0;
  const std::uint64_t* mask[2];
  const std::uint32_t* first[2];
  float weight[2];
};

HWY_INLINE void find_pair(const RowsView& rows, const SamplePlane& plane, int y, RowPair& pair) {
  pair.count = 0;
  if (y < 0 || y >= rows.count[1]) return;
  for (int deep = 0; deep < 2; ++deep) {
    const int zz = plane.slice + deep;
    const float weight = deep != 0 ? plane.beyond : 1 - plane.beyond;
    if (weight == 0 || zz < 0 || zz >= rows.count[2]) continue;
    const std::ptrdiff_t row = y * rows.row[1] + zz * rows.row[2];
    pair.mask[pair.count] = rows.mask + row * rows.words;
    pair.first[pair.count] = rows.first + row * rows.groups;
    pair.weight[pair.count++] = weight;
  }
}

/// Prefetches blocks begin ... end - 1 of a pair of rows early, since they are usually not cached.
/// @returns whether any of them is stored
HWY_INLINE bool prefetch_pair(const RowsView& rows, const RowPair& pair, int begin, int end,
                              const LitBlockCache& lit) {
  bool any = false;
  for (int n = 0; n < pair.count; ++n)
    for (int b = begin < 0 ? 0 : begin; b < end && b < rows.blocks; ++b) {
      const std::uint32_t index = slot_of(pair.mask[n], pair.first[n], b);
      if (index == 0) continue;
      any = true;
      if (!is_lit(index, lit)) __builtin_prefetch(&rows.voxels[index]);
    }
  return any;
}

/// Mixes blocks begin ... end - 1 of a pair of rows, with `to` starting at block `first`; blocks beyond
/// either end count as empty.
HWY_NOINLINE void mix_pair(const RowsView& rows, const RowPair& pair, int begin, int end, int first,
                           LitBlockCache& lit, float* const* to) {
  const DF d;
  for (int b = begin; b < end; ++b) {
    const int at = (b - first) * kBlock;
    const LitBlock* blocks[2];
    LitBlock lateral;
    std::uint32_t offsets[2];
    float weights[2];
    int count = 0;
    if (b >= 0 && b < rows.blocks) {
      for (int n = 0; n < pair.count; ++n) {
        const std::uint32_t index = slot_of(pair.mask[n], pair.first[n], b);
        if (index == 0) continue;
        // the second block may evict the first from its slot
        if (count == 1 && (offsets[0] - index) % LitBlockCache::kCount == 0) {
          lateral = *blocks[0];
          blocks[0] = &lateral;
        }
        blocks[count] = &lit_block(rows, index, lit);
        offsets[count] = index;
        weights[count++] = pair.weight[n];
      }
    }
    for (int n = 0; n < kBlock; n += lanes()) {
      VF red = hn::Zero(d), green = red, blue = red, extinction = red;
      for (int m = 0; m < count; ++m) {
        const VU red_green = hn::LoadU(DU(), blocks[m]->pair[0] + n),
                 blue_extinction = hn::LoadU(DU(), blocks[m]->pair[1] + n);
        const VF weight = hn::Set(d, weights[m]);
        red = hn::Add(red, hn::Mul(lower_of(red_green), weight));
        green = hn::Add(green, hn::Mul(upper_of(red_green), weight));
        blue = hn::Add(blue, hn::Mul(lower_of(blue_extinction), weight));
        extinction = hn::Add(extinction, hn::Mul(upper_of(blue_extinction), weight));
      }
      hn::StoreU(red, d, to[0] + at + n);
      hn::StoreU(green, d, to[1] + at + n);
      hn::StoreU(blue, d, to[2] + at + n);
      hn::StoreU(extinction, d, to[3] + at + n);
    }
  }
}

/// Line between two mixed rows, with constant weights.
struct MixedLine {
  const float* const* near;
  const float* const* far;
  float near_weight, far_weight;
};

/// Sample distance in voxels below which the cells of a vector of samples begin within one vector of voxels.
constexpr float kClose = 0.999f;

/// Samples a chunk's pixels that are not opaque.
/// @param row_x  coordinate of the chunk's first pixel along the mixed row, voxels
/// @returns whether all pixels are opaque now
template <bool kIsClose>
HWY_NOINLINE bool sample_chunk(const AccumulatedLine& line, const MixedLine& mixed, int at, float row_x,
                               float step, float plane) {
  const DF d;
  const DI di;
  const auto scale = hn::Set(d, 1 / kDepthSteps), near_weight = hn::Set(d, mixed.near_weight),
             far_weight = hn::Set(d, mixed.far_weight);
  auto any = hn::FirstN(d, 0);
  for (int n = 0; n < kChunk; n += lanes()) {
    const VF x = hn::Add(hn::Set(d, row_x), hn::Mul(hn::Iota(d, static_cast<float>(n)), hn::Set(d, step)));
    const VI low = hn::ConvertTo(di, x);
    const VF part = hn::Sub(x, hn::ConvertTo(d, low));
    const int first = static_cast<int>(hn::GetLane(low));
    const auto table =
        hn::IndicesFromVec(d, hn::Min(hn::Sub(low, hn::Set(di, first)), hn::Set(di, lanes() - 1)));
    const auto mix = [&](VF near, VF far)
                         HWY_ATTR { return hn::Add(hn::Mul(near, near_weight), hn::Mul(far, far_weight)); };
    // a channel is read only if extinction is non-zero
    const auto between = [&](int channel) HWY_ATTR {
      const float *near = mixed.near[channel], *far = mixed.far[channel];
      VF a, b;
      if constexpr (kIsClose) {
        near += first;
        far += first;
        a = hn::TableLookupLanes(mix(hn::LoadU(d, near), hn::LoadU(d, far)), table);
        b = hn::TableLookupLanes(mix(hn::LoadU(d, near + 1), hn::LoadU(d, far + 1)), table);
      } else {
        a = mix(hn::GatherIndex(d, near, low), hn::GatherIndex(d, far, low));
        b = mix(hn::GatherIndex(d, near + 1, low), hn::GatherIndex(d, far + 1, low));
      }
      return hn::Add(a, hn::Mul(part, hn::Sub(b, a)));
    };
    const VF before = hn::LoadU(d, line.transmittance + at + n);
    // rows around the other pixels may not have been mixed
    const auto sees = hn::Ge(before, hn::Set(d, kDone));
    const VF extinction = hn::IfThenElseZero(sees, hn::Mul(between(3), scale));
    const auto is_there = hn::Gt(extinction, hn::Zero(d));
    if (hn::AllFalse(d, is_there)) {
      any = hn::Or(any, sees);
      continue;
    }
    VF path = hn::LoadU(d, line.step + at + n);
    if (line.first != nullptr) {
      const VF q = hn::Set(d, plane + 0.5f), zero = hn::Zero(d), one = hn::Set(d, 1.0f);
      const VF begun = hn::Sub(q, hn::LoadU(d, line.first + at + n));
      const VF left = hn::Sub(hn::Add(hn::LoadU(d, line.last + at + n), one), q);
      path = hn::Mul(path, hn::Mul(hn::Min(hn::Max(begun, zero), one), hn::Min(hn::Max(left, zero), one)));
    }
    const VF depth = hn::Mul(extinction, path);
    const VF after = hn::Mul(before, exp_of_minus(d, depth));
    const VF begun = hn::LoadU(d, line.first_filled + at + n);
    hn::StoreU(hn::IfThenElse(is_there, hn::Min(begun, hn::Set(d, plane)), begun), d,
               line.first_filled + at + n);
    const VF fraction = hn::Div(hn::Sub(before, after), hn::Max(extinction, hn::Set(d, kTiny)));
    for (int c = 0; c < 3; ++c) {
      const VF light = hn::Mul(between(c), scale);
      float* sum = line.channel[c] + at + n;
      hn::StoreU(hn::Add(hn::LoadU(d, sum), hn::Mul(fraction, light)), d, sum);
    }
    hn::StoreU(after, d, line.transmittance + at + n);
    any = hn::Or(any, hn::Ge(after, hn::Set(d, kDone)));

    if (line.half_plane == nullptr) continue;
    const VF middle = hn::Set(d, 0.5f);
    const auto meets = hn::And(hn::Gt(before, middle), hn::Le(after, middle));
    if (!hn::AllFalse(d, meets)) {
      // extinction is constant within a sample's interval
      HWY_ALIGN float was[kChunk], through[kChunk], is[kChunk];
      hn::Store(before, d, was);
      hn::Store(depth, d, through);
      hn::Store(after, d, is);
      for (int m = 0; m < lanes(); ++m)
        if (was[m] > 0.5f && is[m] <= 0.5f)
          line.half_plane[at + n + m] = plane - 0.5f + std::log(2 * was[m]) / through[m];
    }
  }
  return hn::AllFalse(d, any);
}

/// First set bit from position `from` on, or `end`.
/// @param word  returns 64 bits
template <class Word>
HWY_INLINE int next_bit(int from, int end, const Word& word) {
  while (from < end) {
    const std::uint64_t bits = word(from / 64) >> (from % 64);
    if (bits != 0) {
      from += static_cast<int>(hwy::Num0BitsBelowLS1Bit_Nonzero64(bits));
      break;
    }
    from = (from / 64 + 1) * 64;
  }
  return from < end ? from : end;
}

/// Neighbouring lines on a plane.
struct LinesOnPlane {
  int first = 0;  ///< First voxel row, the one before the first line; the others follow
  int row_count = 0;
  RowPair rows[kMaxRows];
  int line_count = 0;
  const AccumulatedLine* line[kMaxLines];
  int before[kMaxLines];  ///< Per line: index in `rows` of the row before it
  float part[kMaxLines];  ///< Per line: fraction beyond that row
};

/// Block of a row that contains voxel x; may be negative.
HWY_INLINE int block_of_voxel(int x) {
  return x >= 0 ? x / kBlock : -1 - (-x - 1) / kBlock;
}

/// Blocks first ... end - 1.
struct BlockRange {
  int first = 0, end = 0;

  void widen(const BlockRange& other) {
    if (end == first) {
      *this = other;
      return;
    }
    if (other.first < first) first = other.first;
    if (other.end > end) end = other.end;
  }
};

/// Blocks around the samples of pixels first ... last.
HWY_INLINE BlockRange blocks_around(const SamplePlane& plane, int first, int last) {
  return {block_of_voxel(static_cast<int>(std::floor(plane.x_per_u * first + plane.x_0))),
          block_of_voxel(static_cast<int>(std::floor(plane.x_per_u * last + plane.x_0)) + 1) + 1};
}

/// Blocks around the non-opaque pixels of a line's chunks begin ... end - 1.
HWY_INLINE BlockRange visited_blocks(const AccumulatedLine& line, const SamplePlane& plane, int begin,
                                     int end) {
  const auto is_open = [&](int chunk) { return (line.unfinished[chunk / 64] >> chunk % 64 & 1) != 0; };
  while (begin < end && !is_open(begin)) ++begin;
  while (begin < end && !is_open(end - 1)) --end;
  if (begin == end) return {};
  // an open chunk contains a non-opaque pixel
  int first = begin * kChunk, last = end * kChunk - 1;
  while (line.transmittance[first] < kDone) ++first;
  while (line.transmittance[last] < kDone) --last;
  return blocks_around(plane, first, last);
}

/// Samples pixels begin ... end - 1, in whole chunks, of the lines with open chunks there.
HWY_NOINLINE void sample_stretch(const RowsView& rows, const LinesOnPlane& lines, const SamplePlane& plane,
                                 float number, int begin, int end, const MixingBuffers& buffers) {
  // beyond these blocks the row is empty, and pixels farther out read its padding
  const int origin = blocks_around(plane, begin, begin).first;
  // only visible parts are mixed, since much of the surroundings is occluded
  BlockRange of_line[kMaxLines], of_row[kMaxRows];
  for (int n = 0; n < lines.line_count; ++n) {
    of_line[n] = visited_blocks(*lines.line[n], plane, begin / kChunk, end / kChunk);
    if (of_line[n].end == of_line[n].first) continue;
    of_row[lines.before[n]].widen(of_line[n]);
    if (lines.part[n] > 0) of_row[lines.before[n] + 1].widen(of_line[n]);
  }
  const float* const* mixed[kMaxRows];
  for (int n = 0; n < lines.row_count; ++n)
    mixed[n] = prefetch_pair(rows, lines.rows[n], of_row[n].first, of_row[n].end, *buffers.lit)
                   ? buffers.pair[n]
                   : nullptr;
  for (int n = 0; n < lines.row_count; ++n)
    if (mixed[n] != nullptr)
      mix_pair(rows, lines.rows[n], of_row[n].first, of_row[n].end, origin, *buffers.lit, buffers.pair[n]);
  const auto step = static_cast<float>(plane.x_per_u);
  const bool close = step <= kClose;
  for (int n = 0; n < lines.line_count; ++n) {
    if (of_line[n].end == of_line[n].first) continue;
    const float part = lines.part[n];
    MixedLine between{mixed[lines.before[n]], part > 0 ? mixed[lines.before[n] + 1] : nullptr, 1 - part,
                      part};
    if (between.near == nullptr && between.far == nullptr) continue;
    // a row without stored blocks was not mixed
    if (between.near == nullptr) between.near = between.far, between.near_weight = 0;
    if (between.far == nullptr) between.far = between.near, between.far_weight = 0;
    const AccumulatedLine& line = *lines.line[n];
    const auto open = [&](int w) { return line.unfinished[w]; };
    for (int chunk = next_bit(begin / kChunk, end / kChunk, open); chunk < end / kChunk;
         chunk = next_bit(chunk + 1, end / kChunk, open)) {
      const int u = chunk * kChunk;
      const auto row_x = static_cast<float>(plane.x_per_u * u + plane.x_0 - origin * kBlock);
      const bool is_done = close ? sample_chunk<true>(line, between, u, row_x, step, number)
                                 : sample_chunk<false>(line, between, u, row_x, step, number);
      if (is_done) line.unfinished[chunk / 64] &= ~(std::uint64_t{1} << (chunk % 64));
    }
  }
}

HWY_NOINLINE void accumulate_lines_on_plane(const RowsView& rows, const LinesOnPlane& lines,
                                            const SamplePlane& plane, float number, int width,
                                            const MixingBuffers& buffers) {
  const auto there = [&](int w) {
    std::uint64_t any = 0;
    for (int n = 0; n < lines.row_count; ++n)
      for (int m = 0; m < lines.rows[n].count; ++m) any |= lines.rows[n].mask[m][w];
    return any;
  };
  const auto not_there = [&](int w) { return ~there(w); };
  const auto open = [&](int w) {
    std::uint64_t any = 0;
    for (int n = 0; n < lines.line_count; ++n) any |= lines.line[n]->unfinished[w];
    return any;
  };
  const auto not_open = [&](int w) { return ~open(w); };
  const int chunks = (width + kChunk - 1) / kChunk;
  int next = 0;  // next chunk to be sampled on this plane
  for (int block = 0; next < chunks;) {
    // run of blocks that are stored in any of the rows
    block = next_bit(block, rows.blocks, there);
    if (block == rows.blocks) return;
    const int end = next_bit(block, rows.blocks, not_there);

    // pixels between the voxel before the run and the one after it
    const double from = (block * kBlock - 1 - plane.x_0) * plane.u_per_x,
                 to = (end * kBlock - plane.x_0) * plane.u_per_x;
    block = end;
    int c = from > next * kChunk ? static_cast<int>(from < width ? from : width) / kChunk : next;
    const int last = to < 0 ? 0 : to < width ? static_cast<int>(to) / kChunk + 1 : chunks;
    while ((c = next_bit(c, last, open)) < last) {
      const int stop = next_bit(c, last, not_open);
      sample_stretch(rows, lines, plane, number, c * kChunk, stop * kChunk, buffers);
      c = stop;
    }
    if (last > next) next = last;
  }
}

/// Processes the open ones among lines v ... v + count - 1 on a plane.
HWY_NOINLINE void accumulate_plane(const RowsView& rows, const SamplePlane& plane, float number, int v,
                                   int count, int width, const AccumulatedLine* lines, const bool* is_open,
                                   const MixingBuffers& buffers) {
  LinesOnPlane near;
  for (int n = 0; n < count; ++n) {
    const double y = plane.y_per_v * (v + n) + plane.y_0;
    if (!is_open[n] || !(y > -1 && y < rows.count[1])) continue;
    const int below = static_cast<int>(y + 1) - 1;
    if (near.line_count > 0 && below + 1 - near.first >= kMaxRows) {
      // lines so far apart that they share few rows are processed separately
      accumulate_lines_on_plane(rows, near, plane, number, width, buffers);
      near.line_count = near.row_count = 0;
    }
    if (near.line_count == 0) near.first = below;
    near.line[near.line_count] = &lines[n];
    near.before[near.line_count] = below - near.first;
    near.part[near.line_count++] = static_cast<float>(y - below);
    for (; near.first + near.row_count <= below + 1; ++near.row_count)
      find_pair(rows, plane, near.first + near.row_count, near.rows[near.row_count]);
  }
  if (near.line_count > 0) accumulate_lines_on_plane(rows, near, plane, number, width, buffers);
}

void accumulate_lines(const RowsView& rows, const SamplePlane* planes, int plane_count, int v, int count,
                      int width, const AccumulatedLine* lines, const MixingBuffers& buffers) {
  const int words = ((width + kChunk - 1) / kChunk + 63) / 64;
  bool is_open[kMaxLines];
  for (int n = 0; n < count; ++n) is_open[n] = true;
  int since = 0;
  for (int p = 0; p < plane_count; ++p) {
    accumulate_plane(rows, planes[p], static_cast<float>(p), v, count, width, lines, is_open, buffers);
    // checked rarely, since a whole line is seldom opaque and the check costs time
    if (++since < 16) continue;
    since = 0;
    bool any = false;
    for (int n = 0; n < count; ++n) {
      std::uint64_t open = 0;
      for (int w = 0; w < words; ++w) open |= lines[n].unfinished[w];
      is_open[n] = open != 0;
      any = any || is_open[n];
    }
    if (!any) return;
  }
}

void pack_line(const AccumulatedLine& line, int width, const float* background, std::uint32_t* packed) {
  const DF d;
  const DI di;
  const hn::RebindToUnsigned<DI> du;
  for (int u = 0; u < (width + kChunk - 1) / kChunk * kChunk; u += lanes()) {
    const VF clear = hn::LoadU(d, line.transmittance + u);
    auto word = hn::Zero(di);
    for (int c = 0; c < 3; ++c) {
      VF value = hn::Add(hn::LoadU(d, line.channel[c] + u), hn::Mul(clear, hn::Set(d, background[c])));
      value = hn::Min(hn::Add(hn::Mul(value, hn::Set(d, 1023.0f)), hn::Set(d, 0.5f)), hn::Set(d, 1023.0f));
      word = hn::Or(hn::ShiftLeft<10>(word), hn::ConvertTo(di, value));
    }
    hn::StoreU(hn::BitCast(du, word), du, packed + u);
  }
}

// ---- rays -------------------------------------------------------------------------------------------------

/// Vector of four numbers on every target, including the scalar one, so Highway's types are not used.
using V4 = float __attribute__((vector_size(16)));

/// Loads four 16-bit integers.
HWY_INLINE V4 load_four(const std::uint32_t* two_pairs) {
  using I4 = std::int32_t __attribute__((vector_size(16)));
  std::uint64_t bits;
  std::memcpy(&bits, two_pairs, sizeof bits);
  using U4 = std::uint16_t __attribute__((vector_size(8)));
  U4 whole;
  std::memcpy(&whole, &bits, sizeof whole);
  return __builtin_convertvector(__builtin_convertvector(whole, I4), V4);
}

HWY_INLINE V4 all_four(float value) {
  return V4{value, value, value, value};
}

/// Scalar version of the same function.
HWY_INLINE float exp_of_minus(float t) {
  const float part = t * (1.0f / 16), y = part < 1 ? part : 1.0f;
  float p = 1.0f / 24;
  p = 1.0f / 6 - y * p;
  p = 0.5f - y * p;
  p = 1.0f - y * p;
  p = 1.0f - y * p;
  p = p * p;
  p = p * p;
  p = p * p;
  return p * p;
}

/// Position on a ray: the voxels before it.
struct RayPosition {
  int x, y;
  float x_part, y_part;  ///< Fractions beyond them
};

HWY_INLINE RayPosition ray_position(const RowsView& rows, float x, float y) {
  RayPosition position;
  // inside the grid, coordinates are above -1
  position.x = static_cast<int>(x + 1) - 1;
  // x + 1 may be rounded up to the border
  if (position.x >= rows.count[0]) position.x = rows.count[0] - 1;
  position.x_part = x - static_cast<float>(position.x);
  position.y = static_cast<int>(y + 1) - 1;
  position.y_part = y - static_cast<float>(position.y);
  return position;
}

/// The eight voxels around a position on a ray: two in each of four rows, in one block or two adjacent ones.
struct InterpolationCell {
  float plane;
  int in_block;  ///< Voxel before the position; if it is a block's last one, the other is in the next block
  float part;    ///< Fraction beyond it
  std::uint32_t offsets[4][2];
  float weight[4];
};

/// Also prefetches the blocks, since those around a single ray are rarely cached.
/// @returns whether any is stored
HWY_INLINE bool find_around(const RowsView& rows, const RayPosition& ray_position, const SamplePlane& plane,
                            const LitBlockCache& lit, InterpolationCell& around) {
  const int block = block_of_voxel(ray_position.x);
  around.in_block = ray_position.x - block * kBlock;
  around.part = ray_position.x_part;
  std::uint32_t any = 0;
  for (int n = 0; n < 4; ++n) {
    const int far = n & 1, deep = n >> 1, yy = ray_position.y + far, zz = plane.slice + deep;
    const bool is_in = yy >= 0 && yy < rows.count[1] && zz >= 0 && zz < rows.count[2];
    const std::ptrdiff_t row = is_in ? yy * rows.row[1] + zz * rows.row[2] : 0;
    for (int m = 0; m < 2; ++m) {
      const int b = block + m;
      const bool is_there = is_in && b >= 0 && b < rows.blocks && (m == 0 || around.in_block == kBlock - 1);
      const std::uint32_t found =
          is_there ? slot_of(rows.mask + row * rows.words, rows.first + row * rows.groups, b) : 0;
      prefetch_block(rows, found, lit);
      around.offsets[n][m] = found;
      any |= found;
    }
    around.weight[n] = (far != 0 ? ray_position.y_part : 1 - ray_position.y_part) *
                       (deep != 0 ? plane.beyond : 1 - plane.beyond);
  }
  return any != 0;
}

/// Mixes their red, green, blue and extinction.
HWY_INLINE V4 mix_voxels(const RowsView& rows, const InterpolationCell& around, LitBlockCache& lit) {
  // two voxels each: red and green; blue and extinction
  V4 first{}, second{};
  for (int n = 0; n < 4; ++n) {
    const auto& offsets = around.offsets[n];
    if ((offsets[0] | offsets[1]) == 0) continue;
    const V4 weight = all_four(around.weight[n]);
    const LitBlock& low = lit_block(rows, offsets[0], lit);
    if (around.in_block < kBlock - 1) {
      first += load_four(low.pair[0] + around.in_block) * weight;
      second += load_four(low.pair[1] + around.in_block) * weight;
      continue;
    }
    std::uint32_t pairs[2][2];
    for (int m = 0; m < 2; ++m) pairs[m][0] = low.pair[m][kBlock - 1];
    const LitBlock& high = lit_block(rows, offsets[1], lit);
    for (int m = 0; m < 2; ++m) pairs[m][1] = high.pair[m][0];
    first += load_four(pairs[0]) * weight;
    second += load_four(pairs[1]) * weight;
  }
  const float near = 1 - around.part, far = around.part;
  const V4 weight{near, near, far, far};
  first *= weight;
  second *= weight;
  return __builtin_shufflevector(first, second, 0, 1, 4, 5) +
         __builtin_shufflevector(first, second, 2, 3, 6, 7);
}

/// Exit of a ray from cubes along x, y and z; the fourth component repeats the third.
struct Leaving {
  V4 planes_per;       ///< Planes per voxel
  V4 towards, beyond;  ///< The exit border is `towards` times `skip` plus `beyond` cubes away
};

HWY_INLINE Leaving leaving_of(const float* pace) {
  Leaving leaving;
  for (int n = 0; n < 4; ++n) {
    const float by = pace[n < 3 ? n : 2];
    // with almost no motion along an axis the ray never exits along it
    leaving.planes_per[n] = std::abs(by) < 1e-6f ? 1e6f : 1 / by;
    leaving.towards[n] = leaving.planes_per[n] > 0 ? 1.0f : -1.0f;
    leaving.beyond[n] = leaving.planes_per[n] > 0 ? 0.0f : 1.0f;
  }
  return leaving;
}

/// Next plane on which the ray has left the empty cubes around a cell.
/// @param ray_position  voxels
HWY_INLINE int skip_empty_cubes(const CubesView& cubes, std::ptrdiff_t index, const int* cell,
                                const V4& ray_position, const Leaving& leaving, int plane) {
  const V4 cube{static_cast<float>(cell[0] >> kCubeShift), static_cast<float>(cell[1] >> kCubeShift),
                static_cast<float>(cell[2] >> kCubeShift), static_cast<float>(cell[2] >> kCubeShift)};
  const V4 border =
      (cube + leaving.towards * all_four(cubes.skip[index]) + leaving.beyond) * all_four(kCubeSide);
  const V4 planes = (border - (ray_position + all_four(1))) * leaving.planes_per;
  const float along = planes[0] < planes[1] ? planes[0] : planes[1],
              away = along < planes[2] ? along : planes[2];
  const int by = static_cast<int>(std::ceil(away - 1e-3f));
  return plane + (by > 1 ? by : 1);
}

/// Range of planes on which a ray is inside the grid or less than a voxel outside, along one axis.
HWY_INLINE void bound_planes(float start, float per_plane, int count, float& begin, float& end) {
  // excludes a margin at the border, where nothing is visible, larger than the accumulated rounding error
  const auto border = static_cast<float>(count);
  const float off = 1e-4f + 4e-7f * (std::abs(start) + border), low = off - 1, high = border - off;
  if (std::abs(per_plane) < 1e-9f) {
    if (start < low || start > high) end = begin;
    return;
  }
  const float a = (low - start) / per_plane, b = (high - start) / per_plane;
  const float enter = std::ceil(a < b ? a : b), leave = std::floor(a < b ? b : a) + 1;
  if (enter > begin) begin = enter;
  if (leave < end) end = leave;
}

HWY_INLINE void trace_ray(const RowsView& rows, const CubesView& cubes, const SamplePlane* planes,
                          int plane_count, float z_per_plane, bool wants_hits, LitBlockCache& lit,
                          TracedRay& ray) {
  V4 sum{};
  float clear = 1;
  ray.half_plane = -1;
  float begin = std::floor(ray.first) - 1, end = std::floor(ray.last) + 2;
  if (ray.first_filled > begin) begin = ray.first_filled;
  if (begin < 0) begin = 0;
  if (static_cast<float>(plane_count) < end) end = static_cast<float>(plane_count);
  bound_planes(ray.x, ray.x_per_plane, rows.count[0], begin, end);
  bound_planes(ray.y, ray.y_per_plane, rows.count[1], begin, end);
  const float pace[3] = {ray.x_per_plane, ray.y_per_plane, z_per_plane};
  const Leaving leaving = leaving_of(pace);
  const int stop = end > begin ? static_cast<int>(end) : 0;
  int p = end > begin ? static_cast<int>(begin) : 0;
  const auto find_next = [&](InterpolationCell& around) HWY_ATTR {
    while (p < stop) {
      const auto plane = static_cast<float>(p);
      const float x = ray.x + ray.x_per_plane * plane, y = ray.y + ray.y_per_plane * plane;
      const RayPosition at = ray_position(rows, x, y);
      const int cell[3] = {at.x + 1, at.y + 1, planes[p].slice + 1};
      std::ptrdiff_t index = 0;
      int bit = 0;
      for (int a = 0; a < 3; ++a) {
        index += (cell[a] >> kCubeShift) * std::ptrdiff_t{cubes.step[a]};
        bit += (cell[a] & (kCubeSide - 1)) << cubes.shift[a];
      }
      const std::uint64_t filled = cubes.filled[index];
      if ((filled >> bit & 1) == 0) {
        const float z = static_cast<float>(planes[p].slice) + planes[p].beyond;
        p = filled != 0 ? p + 1 : skip_empty_cubes(cubes, index, cell, V4{x, y, z, z}, leaving, p);
        continue;
      }
      around.plane = plane;
      if (find_around(rows, at, planes[p++], lit, around)) return true;
    }
    return false;
  };
  // software pipelining: find the next position and prefetch its voxels while the current ones are being
  // loaded
  InterpolationCell found[2];
  bool is_found = find_next(found[0]);
  for (int n = 0; is_found && clear >= kDone; n = 1 - n) {
    is_found = find_next(found[1 - n]);
    const V4 mixed = mix_voxels(rows, found[n], lit);
    // voxels with zero weight contribute nothing
    if (mixed[3] == 0) continue;
    const float plane = found[n].plane, q = plane + 0.5f;
    float begun = q - ray.first, left = ray.last + 1 - q;
    begun = begun < 0 ? 0 : begun > 1 ? 1 : begun;
    left = left < 0 ? 0 : left > 1 ? 1 : left;
    const float extinction = mixed[3] * (1 / kDepthSteps), depth = extinction * (ray.step * (begun * left)),
                after = clear * exp_of_minus(depth);
    const float fraction = (clear - after) / (extinction > kTiny ? extinction : kTiny) * (1 / kDepthSteps);
    sum += mixed * all_four(fraction);
    if (wants_hits && clear > 0.5f && after <= 0.5f)
      ray.half_plane = plane - 0.5f + std::log(2 * clear) / depth;
    clear = after;
  }
  for (int c = 0; c < 3; ++c) ray.channel[c] = sum[c];
  ray.transmittance = clear;
}

void trace_rays(const RowsView& rows, const CubesView& cubes, const SamplePlane* planes, int plane_count,
                float z_per_plane, bool wants_hits, int count, TracedRay* rays, LitBlockCache& lit) {
  for (int n = 0; n < count; ++n)
    trace_ray(rows, cubes, planes, plane_count, z_per_plane, wants_hits, lit, rays[n]);
}

// ---- the warp ---------------------------------------------------------------------------------------------

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

HWY_EXPORT(accumulate_lines);
HWY_EXPORT(pack_line);
HWY_EXPORT(mark_line);
HWY_EXPORT(warp_row);
HWY_EXPORT(trace_rays);

void accumulate_lines(const RowsView& rows, const SamplePlane* planes, int plane_count, int v, int count,
                      int width, const AccumulatedLine* lines, const MixingBuffers& buffers) {
  HWY_DYNAMIC_DISPATCH(accumulate_lines)(rows, planes, plane_count, v, count, width, lines, buffers);
}
void pack_line(const AccumulatedLine& line, int width, const float* background, std::uint32_t* packed) {
  HWY_DYNAMIC_DISPATCH(pack_line)(line, width, background, packed);
}
int warp_row(const Warp& warp, int begin, int end, std::uint8_t* rgb, std::int32_t* edges) {
  return HWY_DYNAMIC_DISPATCH(warp_row)(warp, begin, end, rgb, edges);
}
void mark_line(const std::uint32_t* above, const std::uint32_t* here, const std::uint32_t* below, int width,
               std::uint32_t* marked) {
  HWY_DYNAMIC_DISPATCH(mark_line)(above, here, below, width, marked);
}
void trace_rays(const RowsView& rows, const CubesView& cubes, const SamplePlane* planes, int plane_count,
                float z_per_plane, bool wants_hits, int count, TracedRay* rays, LitBlockCache& lit) {
  HWY_DYNAMIC_DISPATCH(trace_rays)
  (rows, cubes, planes, plane_count, z_per_plane, wants_hits, count, rays, lit);
}

}  // namespace palpate::internal::volume_picture
#endif  // HWY_ONCE
