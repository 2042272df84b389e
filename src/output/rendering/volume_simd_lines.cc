// Neighbouring lines of intermediate pixels are accumulated over the sampling planes together. On each plane:
//
//     blocks   runs of stored blocks in the voxel rows around the lines, by bit operations
//     pixels   chunks of a run in which some pixel is not opaque yet
//     rows     the two voxel rows before and behind the plane are mixed to one, in float
//     samples  interpolation between the two mixed rows around the line, with constant weights, and between
//              two voxels along it; accumulation
//
// These are separate functions that are not inlined: a single body would exceed the registers, and takes a
// tenth longer. No fused operations are used: bit-identical on every target.

#include <cmath>
#include <cstring>

#include "rendering/volume_simd.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "rendering/volume_simd_lines.cc"
#include <hwy/foreach_target.h>
// after foreach_target.h
#include <hwy/highway.h>

#include "rendering/volume_simd-inl.h"

HWY_BEFORE_NAMESPACE();
namespace palpate::internal::volume_picture::HWY_NAMESPACE {

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

}  // namespace palpate::internal::volume_picture::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace palpate::internal::volume_picture {

HWY_EXPORT(accumulate_lines);
HWY_EXPORT(pack_line);

void accumulate_lines(const RowsView& rows, const SamplePlane* planes, int plane_count, int v, int count,
                      int width, const AccumulatedLine* lines, const MixingBuffers& buffers) {
  HWY_DYNAMIC_DISPATCH(accumulate_lines)(rows, planes, plane_count, v, count, width, lines, buffers);
}
void pack_line(const AccumulatedLine& line, int width, const float* background, std::uint32_t* packed) {
  HWY_DYNAMIC_DISPATCH(pack_line)(line, width, background, packed);
}

}  // namespace palpate::internal::volume_picture
#endif  // HWY_ONCE
