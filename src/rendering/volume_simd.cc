#include "rendering/volume_simd.h"

// A line of intermediate pixels gathers from one plane of samples after another. On each:
//
//     blocks   which of the up to four rows of voxels around the line are there, by bits: runs of them
//     pixels   of a run, in chunks, those that still see something
//     row      the four rows become one, in float: their weights are the same all along the line
//     samples  between two voxels of it, and what each adds
//
// No operation is fused: the same bits on every target. Compiled once per target by foreach_target.h; only
// what is marked HWY_INLINE and the functions at the end live in the target's namespace.

#include <cmath>

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

constexpr int kLeapShift = 2;
static_assert(kLeapSide == 1 << kLeapShift);
/// What still sees so little is done.
constexpr float kDone = 1.0f / 512;
constexpr float kTiny = 1e-7f;
/// Intermediate pixels that differ by more than this are not mixed, of 1023.
constexpr float kEdge = 44;

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

void light_blocks(const VoxelBlock* voxels, const std::uint32_t* which, std::size_t count,
                  const LightFall& light, LitBlock* lit) {
  const DF d;
  const DI di;
  const auto one = hn::Set(d, 1.0f), half = hn::Set(d, 0.5f), most = hn::Set(d, 65535.0f);
  const auto per_step = hn::Set(d, 1 / kNormalSteps), per_colour = hn::Set(d, 1.0f / 255);
  for (std::size_t b = 0; b < count; ++b) {
    const VoxelBlock& from = voxels[which[b]];
    LitBlock& to = lit[which[b]];
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
      const VF dull = hn::Add(hn::Set(d, light.ambient), hn::Mul(hn::Set(d, light.diffuse), facing));
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
}

// ---- a line -----------------------------------------------------------------------------------------------

/// e^-t for t >= 0, to 1e-4: the sixteenth power of a series.
HWY_INLINE VF exp_of_minus(VF t) {
  const DF d;
  const VF y = hn::Min(hn::Mul(t, hn::Set(d, 1.0f / 16)), hn::Set(d, 1.0f));
  VF p = hn::Set(d, 1.0f / 24);
  p = hn::Sub(hn::Set(d, 1.0f / 6), hn::Mul(y, p));
  p = hn::Sub(hn::Set(d, 0.5f), hn::Mul(y, p));
  p = hn::Sub(hn::Set(d, 1.0f), hn::Mul(y, p));
  p = hn::Sub(hn::Set(d, 1.0f), hn::Mul(y, p));
  p = hn::Mul(p, p);
  p = hn::Mul(p, p);
  p = hn::Mul(p, p);
  return hn::Mul(p, p);
}

/// Rows of voxels around a line on a plane: up to four that count.
struct AroundLine {
  int count = 0;
  const std::uint64_t* mask[4];
  const std::uint32_t* block_of[4];
  float weight[4];
};

HWY_INLINE void find_rows(const RowsView& rows, const SamplePlane& plane, int v, AroundLine& around) {
  around.count = 0;
  const double y = plane.y_per_v * v + plane.y_0;
  if (!(y > -1 && y < rows.count[1])) return;
  const int below = static_cast<int>(y + 1) - 1;
  const auto part = static_cast<float>(y - below);
  for (int n = 0; n < 4; ++n) {
    const int far = n & 1, deep = n >> 1, yy = below + far, zz = plane.slice + deep;
    const float weight = (far != 0 ? part : 1 - part) * (deep != 0 ? plane.beyond : 1 - plane.beyond);
    if (weight == 0 || yy < 0 || zz < 0 || yy >= rows.count[1] || zz >= rows.count[2]) continue;
    const std::ptrdiff_t row = yy * rows.row[1] + zz * rows.row[2];
    around.mask[around.count] = rows.mask + row * rows.words;
    around.block_of[around.count] = rows.block_of + row * rows.blocks;
    around.weight[around.count++] = weight;
  }
}

/// Blocks begin ... end - 1 of the rows as one, from `to` on; those beyond either end are empty.
HWY_INLINE void mix_rows(const RowsView& rows, const AroundLine& around, int begin, int end,
                         float* const* to) {
  const DF d;
  for (int b = begin; b < end; ++b) {
    const int at = (b - begin) * kBlock;
    const LitBlock* blocks[4];
    float weights[4];
    int count = 0;
    if (b >= 0 && b < rows.blocks) {
      for (int n = 0; n < around.count; ++n) {
        const std::uint32_t place = around.block_of[n][b];
        if (place == 0) continue;
        blocks[count] = rows.lit + place;
        weights[count++] = around.weight[n];
      }
    }
    for (int n = 0; n < kBlock; n += lanes()) {
      VF red = hn::Zero(d), green = red, blue = red, extinction = red;
      for (int m = 0; m < count; ++m) {
        const VU first = hn::LoadU(DU(), blocks[m]->pair[0] + n),
                 second = hn::LoadU(DU(), blocks[m]->pair[1] + n);
        const VF weight = hn::Set(d, weights[m]);
        red = hn::Add(red, hn::Mul(lower_of(first), weight));
        green = hn::Add(green, hn::Mul(upper_of(first), weight));
        blue = hn::Add(blue, hn::Mul(lower_of(second), weight));
        extinction = hn::Add(extinction, hn::Mul(upper_of(second), weight));
      }
      hn::StoreU(red, d, to[0] + at + n);
      hn::StoreU(green, d, to[1] + at + n);
      hn::StoreU(blue, d, to[2] + at + n);
      hn::StoreU(extinction, d, to[3] + at + n);
    }
  }
}

/// So far from sample to sample, in voxels, that the cells of a vector's samples begin within a vector of
/// voxels.
constexpr float kClose = 0.999f;

/// A chunk's pixels take a sample each. @param place  of the first one in the mixed row
/// @returns whether nothing more is seen by any
template <bool kIsClose>
HWY_INLINE bool take_samples(const Gathered& line, int at, float place, float step, float plane) {
  const DF d;
  const DI di;
  const auto scale = hn::Set(d, 1 / kDepthSteps);
  auto any = hn::FirstN(d, 0);
  for (int n = 0; n < kChunk; n += lanes()) {
    const VF x = hn::Add(hn::Set(d, place), hn::Mul(hn::Iota(d, static_cast<float>(n)), hn::Set(d, step)));
    const VI low = hn::ConvertTo(di, x);
    const VF part = hn::Sub(x, hn::ConvertTo(d, low));
    const int first = static_cast<int>(hn::GetLane(low));
    const auto table =
        hn::IndicesFromVec(d, hn::Min(hn::Sub(low, hn::Set(di, first)), hn::Set(di, lanes() - 1)));
    const auto between = [&](const float* row) HWY_ATTR {
      VF a, b;
      if constexpr (kIsClose) {
        a = hn::TableLookupLanes(hn::LoadU(d, row + first), table);
        b = hn::TableLookupLanes(hn::LoadU(d, row + first + 1), table);
      } else {
        a = hn::GatherIndex(d, row, low);
        b = hn::GatherIndex(d, row + 1, low);
      }
      return hn::Add(a, hn::Mul(part, hn::Sub(b, a)));
    };
    const VF extinction = hn::Mul(between(line.row[3]), scale);
    VF way = hn::LoadU(d, line.step + at + n);
    if (line.first != nullptr) {
      const VF q = hn::Set(d, plane + 0.5f), zero = hn::Zero(d), one = hn::Set(d, 1.0f);
      const VF begun = hn::Sub(q, hn::LoadU(d, line.first + at + n));
      const VF left = hn::Sub(hn::Add(hn::LoadU(d, line.last + at + n), one), q);
      way = hn::Mul(way, hn::Mul(hn::Min(hn::Max(begun, zero), one), hn::Min(hn::Max(left, zero), one)));
    }
    const VF depth = hn::Mul(extinction, way);
    const VF before = hn::LoadU(d, line.clear + at + n), after = hn::Mul(before, exp_of_minus(depth));
    const VF share = hn::Div(hn::Sub(before, after), hn::Max(extinction, hn::Set(d, kTiny)));
    for (int c = 0; c < 3; ++c) {
      const VF light = hn::Mul(between(line.row[c]), scale);
      float* sum = line.channel[c] + at + n;
      hn::StoreU(hn::Add(hn::LoadU(d, sum), hn::Mul(share, light)), d, sum);
    }
    hn::StoreU(after, d, line.clear + at + n);
    any = hn::Or(any, hn::Ge(after, hn::Set(d, kDone)));

    if (line.met == nullptr) continue;
    const VF middle = hn::Set(d, 0.5f);
    const auto meets = hn::And(hn::Gt(before, middle), hn::Le(after, middle));
    if (!hn::AllFalse(d, meets)) {
      // in a sample's stretch extinction is the same all along
      HWY_ALIGN float was[kChunk], through[kChunk], is[kChunk];
      hn::Store(before, d, was);
      hn::Store(depth, d, through);
      hn::Store(after, d, is);
      for (int m = 0; m < lanes(); ++m)
        if (was[m] > 0.5f && is[m] <= 0.5f)
          line.met[at + n + m] = plane - 0.5f + std::log(2 * was[m]) / through[m];
    }
  }
  return hn::AllFalse(d, any);
}

/// Takes samples of pixels begin ... end - 1, whole chunks of which none is done.
HWY_INLINE void sample_stretch(const RowsView& rows, const AroundLine& around, const SamplePlane& plane,
                               float number, int begin, int end, const Gathered& line) {
  const double first = plane.x_per_u * begin + plane.x_0, last = plane.x_per_u * (end - 1) + plane.x_0;
  // beyond these blocks the row is empty, and pixels farther out read its padding
  const int lowest = static_cast<int>(std::floor(first)), highest = static_cast<int>(std::floor(last)) + 1;
  const int from = lowest >= 0 ? lowest / kBlock : -1 - (-lowest - 1) / kBlock,
            to = highest >= 0 ? highest / kBlock + 1 : -((-highest - 1) / kBlock);
  mix_rows(rows, around, from, to, line.row);
  const auto step = static_cast<float>(plane.x_per_u);
  const bool close = step <= kClose;
  for (int u = begin; u < end; u += kChunk) {
    const auto place = static_cast<float>(plane.x_per_u * u + plane.x_0 - from * kBlock);
    line.done[u / kChunk] = (close ? take_samples<true>(line, u, place, step, number)
                                   : take_samples<false>(line, u, place, step, number))
                                ? 1
                                : 0;
  }
}

HWY_INLINE void gather_plane(const RowsView& rows, const SamplePlane& plane, float number, int v, int width,
                             const Gathered& line) {
  AroundLine around;
  find_rows(rows, plane, v, around);
  if (around.count == 0) return;
  const int chunks = (width + kChunk - 1) / kChunk;
  int next = 0;  // chunk that has not been sampled on this plane
  int block = 0;
  while (block < rows.blocks && next < chunks) {
    // a run of blocks, one of which is there in any of the rows
    const auto there = [&](int w) {
      std::uint64_t any = 0;
      for (int n = 0; n < around.count; ++n) any |= around.mask[n][w];
      return any;
    };
    std::uint64_t bits = there(block / 64) >> (block % 64);
    if (bits == 0) {
      block = (block / 64 + 1) * 64;
      continue;
    }
    block += static_cast<int>(hwy::Num0BitsBelowLS1Bit_Nonzero64(bits));
    int end = block;
    while (end < rows.blocks) {
      bits = ~there(end / 64) >> (end % 64);
      if (bits != 0) {
        end += static_cast<int>(hwy::Num0BitsBelowLS1Bit_Nonzero64(bits));
        break;
      }
      end = (end / 64 + 1) * 64;
    }
    if (end > rows.blocks) end = rows.blocks;

    // the pixels between the voxel before it and the one after it
    const double from = (block * kBlock - 1 - plane.x_0) / plane.x_per_u,
                 to = (end * kBlock - plane.x_0) / plane.x_per_u;
    block = end;
    int c = from > next * kChunk ? static_cast<int>(from < width ? from : width) / kChunk : next;
    const int last = to < 0 ? 0 : to < width ? static_cast<int>(to) / kChunk + 1 : chunks;
    while (c < last) {
      if (line.done[c] != 0) {
        ++c;
        continue;
      }
      int stop = c + 1;
      while (stop < last && line.done[stop] == 0) ++stop;
      sample_stretch(rows, around, plane, number, c * kChunk, stop * kChunk, line);
      c = stop;
    }
    if (last > next) next = last;
  }
}

void gather_line(const RowsView& rows, const SamplePlane* planes, int plane_count, int v, int width,
                 const Gathered& line) {
  const int chunks = (width + kChunk - 1) / kChunk;
  int since = 0;
  for (int p = 0; p < plane_count; ++p) {
    gather_plane(rows, planes[p], static_cast<float>(p), v, width, line);
    // all of a line is seldom done, and looking costs
    if (++since < 16) continue;
    since = 0;
    int c = 0;
    while (c < chunks && line.done[c] != 0) ++c;
    if (c == chunks) return;
  }
}

void pack_line(const Gathered& line, int width, const float* background, std::uint32_t* packed) {
  const DF d;
  const DI di;
  const hn::RebindToUnsigned<DI> du;
  for (int u = 0; u < width; u += lanes()) {
    const VF clear = hn::LoadU(d, line.clear + u);
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

/// Eight voxels around each of a vector of places, mixed.
struct MixedVoxels {
  VF red, green, blue, extinction;
};

HWY_INLINE MixedVoxels mix_voxels(const RowsView& rows, VF x, VF y, VF z) {
  const DF d;
  const DI di;
  const auto one = hn::Set(di, 1);
  const VF floors[3] = {hn::Floor(x), hn::Floor(y), hn::Floor(z)}, at[3] = {x, y, z};
  VI low[3];
  VF part[3];
  for (int a = 0; a < 3; ++a) {
    low[a] = hn::ConvertTo(di, floors[a]);
    part[a] = hn::Sub(at[a], floors[a]);
  }
  const auto* block_of = reinterpret_cast<const std::int32_t*>(rows.block_of);
  const auto* pairs = reinterpret_cast<const std::int32_t*>(rows.lit);
  const auto weight_of = [&](int axis, int far) HWY_ATTR {
    return far != 0 ? part[axis] : hn::Sub(hn::Set(d, 1.0f), part[axis]);
  };
  const auto is_within = [&](int axis, VI index) HWY_ATTR {
    return hn::And(hn::Gt(index, hn::Set(di, -1)), hn::Lt(index, hn::Set(di, rows.count[axis])));
  };
  MixedVoxels sum{hn::Zero(d), hn::Zero(d), hn::Zero(d), hn::Zero(d)};
  const VI next = hn::Add(low[0], one), in_block = hn::Set(di, kBlock - 1);
  const auto here_is_within = is_within(0, low[0]), next_is_within = is_within(0, next);
  // most pairs of voxels along a row are of one block
  const bool one_block = hn::AllFalse(di, hn::Eq(hn::And(low[0], in_block), in_block));
  const auto add = [&](VI place, VI along, VF weight) HWY_ATTR {
    const VI word = hn::Add(hn::ShiftLeft<4>(place), hn::And(along, in_block));
    const VU first = hn::BitCast(DU(), hn::GatherIndex(di, pairs, word)),
             second = hn::BitCast(DU(), hn::GatherIndex(di, pairs + kBlock, word));
    sum.red = hn::Add(sum.red, hn::Mul(lower_of(first), weight));
    sum.green = hn::Add(sum.green, hn::Mul(upper_of(first), weight));
    sum.blue = hn::Add(sum.blue, hn::Mul(lower_of(second), weight));
    sum.extinction = hn::Add(sum.extinction, hn::Mul(upper_of(second), weight));
  };
  for (int corner = 0; corner < 4; ++corner) {
    const int far_y = corner & 1, far_z = corner >> 1;
    const VI yy = far_y != 0 ? hn::Add(low[1], one) : low[1], zz = far_z != 0 ? hn::Add(low[2], one) : low[2];
    const auto row_is_there = hn::And(is_within(1, yy), is_within(2, zz));
    const VI row = hn::Mul(hn::Add(hn::Mul(yy, hn::Set(di, static_cast<std::int32_t>(rows.row[1]))),
                                   hn::Mul(zz, hn::Set(di, static_cast<std::int32_t>(rows.row[2])))),
                           hn::Set(di, rows.blocks));
    const auto place_of = [&](VI along, hn::Mask<DI> is_along_within) HWY_ATTR {
      const auto there = hn::And(row_is_there, is_along_within);
      const VI block = hn::IfThenElseZero(there, hn::Add(row, hn::ShiftRight<3>(along)));
      return hn::IfThenElseZero(there, hn::GatherIndex(di, block_of, block));
    };
    const VI here = place_of(low[0], here_is_within);
    const VI beside = one_block ? here : place_of(next, next_is_within);
    if (hn::AllTrue(di, hn::Eq(hn::Or(here, beside), hn::Zero(di)))) continue;
    const VF weight = hn::Mul(weight_of(1, far_y), weight_of(2, far_z));
    add(here, low[0], hn::Mul(weight, weight_of(0, 0)));
    add(beside, next, hn::Mul(weight, weight_of(0, 1)));
  }
  return sum;
}

/// How many planes on a ray leaves, along one axis, the cubes that are empty. `from` is its place in cells.
HWY_INLINE VF planes_to_leave(VF from, VI cube, VI leap, VF per_plane) {
  const DF d;
  const DI di;
  const VF side = hn::Set(d, static_cast<float>(kLeapSide)), tiny = hn::Set(d, 1e-9f);
  const VF upper = hn::Mul(side, hn::ConvertTo(d, hn::Add(cube, leap))),
           lower = hn::Mul(side, hn::ConvertTo(d, hn::Add(hn::Sub(cube, leap), hn::Set(di, 1))));
  const auto ascends = hn::Ge(per_plane, hn::Zero(d));
  const VF pace = hn::IfThenElse(ascends, hn::Max(per_plane, tiny), hn::Min(per_plane, hn::Neg(tiny)));
  return hn::Div(hn::Sub(hn::IfThenElse(ascends, upper, lower), from), pace);
}

HWY_INLINE void trace_vector(const RowsView& rows, const LeapsView& leaps, const PlaneRange& planes, int at,
                             const TracedRays& rays) {
  const DF d;
  const DI di;
  const VF zero = hn::Zero(d), one = hn::Set(d, 1.0f), half = hn::Set(d, 0.5f),
           scale = hn::Set(d, 1 / kDepthSteps);
  const VF start[3] = {hn::LoadU(d, rays.x + at), hn::LoadU(d, rays.y + at), hn::Set(d, planes.z)};
  const VF pace[3] = {hn::LoadU(d, rays.x_per_plane + at), hn::LoadU(d, rays.y_per_plane + at),
                      hn::Set(d, planes.z_per_plane)};
  const VF step = hn::LoadU(d, rays.step + at), first = hn::LoadU(d, rays.first + at),
           last = hn::LoadU(d, rays.last + at);
  VF red = zero, green = zero, blue = zero, clear = one, met = hn::Set(d, -1.0f);

  // the planes on which a ray is in the grid or less than a voxel beside it
  VF plane = hn::Max(zero, hn::Sub(hn::Floor(first), one));
  VF end = hn::Min(hn::Set(d, static_cast<float>(planes.count)), hn::Add(hn::Floor(last), hn::Set(d, 2.0f)));
  for (int a = 0; a < 2; ++a) {
    const VF tiny = hn::Set(d, 1e-9f);
    const VF per =
        hn::IfThenElse(hn::Ge(pace[a], zero), hn::Max(pace[a], tiny), hn::Min(pace[a], hn::Neg(tiny)));
    const VF low = hn::Div(hn::Sub(hn::Set(d, -1.0f), start[a]), per),
             high = hn::Div(hn::Sub(hn::Set(d, static_cast<float>(rows.count[a])), start[a]), per);
    plane = hn::Max(plane, hn::Ceil(hn::Min(low, high)));
    end = hn::Min(end, hn::Add(hn::Floor(hn::Max(low, high)), one));
  }
  for (;;) {
    const auto going = hn::And(hn::Lt(plane, end), hn::Ge(clear, hn::Set(d, kDone)));
    if (hn::AllFalse(d, going)) break;
    VF place[3], cell[3];
    VI cube[3], index = hn::Zero(di);
    for (int a = 0; a < 3; ++a) {
      place[a] = hn::IfThenElseZero(going, hn::Add(start[a], hn::Mul(pace[a], plane)));
      // in the first and the last cell where rounding is beyond them
      place[a] = hn::Min(hn::Max(place[a], hn::Set(d, -1.0f)),
                         hn::Set(d, static_cast<float>(rows.count[a]) - 1e-3f));
      cell[a] = hn::Add(place[a], one);
      cube[a] = hn::ShiftRight<kLeapShift>(hn::ConvertTo(di, cell[a]));
      index = hn::Add(index, hn::Mul(cube[a], hn::Set(di, leaps.step[a])));
    }
    const VI leap = hn::GatherIndex(di, leaps.leap, index);
    const auto is_empty = hn::RebindMask(d, hn::Gt(leap, hn::Zero(di)));
    const auto sampled = hn::And(going, hn::Not(is_empty));
    VF next = hn::Add(plane, one);
    if (!hn::AllFalse(d, is_empty)) {
      VF away = hn::Set(d, 1e9f);
      for (int a = 0; a < 3; ++a) away = hn::Min(away, planes_to_leave(cell[a], cube[a], leap, pace[a]));
      const VF leapt = hn::Max(next, hn::Ceil(hn::Add(plane, hn::Sub(away, hn::Set(d, 1e-3f)))));
      next = hn::IfThenElse(is_empty, leapt, next);
    }
    if (!hn::AllFalse(d, sampled)) {
      const MixedVoxels voxels = mix_voxels(rows, place[0], place[1], place[2]);
      const VF q = hn::Add(plane, half);
      const VF begun = hn::Min(hn::Max(hn::Sub(q, first), zero), one),
               left = hn::Min(hn::Max(hn::Sub(hn::Add(last, one), q), zero), one);
      const VF way = hn::IfThenElseZero(sampled, hn::Mul(step, hn::Mul(begun, left)));
      const VF extinction = hn::Mul(voxels.extinction, scale), depth = hn::Mul(extinction, way);
      const VF after = hn::Mul(clear, exp_of_minus(depth));
      const VF share = hn::Mul(scale, hn::Div(hn::Sub(clear, after), hn::Max(extinction, hn::Set(d, kTiny))));
      red = hn::Add(red, hn::Mul(share, voxels.red));
      green = hn::Add(green, hn::Mul(share, voxels.green));
      blue = hn::Add(blue, hn::Mul(share, voxels.blue));
      const auto meets = hn::And(hn::Gt(clear, half), hn::Le(after, half));
      met = hn::IfThenElse(meets, plane, met);
      clear = after;
    }
    plane = hn::IfThenElse(going, next, plane);
  }
  hn::StoreU(red, d, rays.channel[0] + at);
  hn::StoreU(green, d, rays.channel[1] + at);
  hn::StoreU(blue, d, rays.channel[2] + at);
  hn::StoreU(clear, d, rays.clear + at);
  hn::StoreU(met, d, rays.met + at);
}

void trace_rays(const RowsView& rows, const LeapsView& leaps, const PlaneRange& planes, int count,
                const TracedRays& rays) {
  for (int n = 0; n < count; n += lanes()) trace_vector(rows, leaps, planes, n, rays);
}

// ---- the warp ---------------------------------------------------------------------------------------------

HWY_INLINE VF channel_of(VI word, int which) {
  const DI di;
  const VI shifted = which == 0 ? hn::ShiftRight<20>(word) : which == 1 ? hn::ShiftRight<10>(word) : word;
  return hn::ConvertTo(DF(), hn::And(shifted, hn::Set(di, 1023)));
}

int warp_row(const Warp& warp, int begin, int end, std::uint8_t* rgb, std::int32_t* edges) {
  const DF d;
  const DI di;
  int edge_count = 0;
  const auto* pixels = reinterpret_cast<const std::int32_t*>(warp.pixels);
  const VI stride = hn::Set(di, static_cast<std::int32_t>(warp.stride)), one = hn::Set(di, 1);
  const VF most_u = hn::Set(d, static_cast<float>(warp.width - 1) - 1e-3f),
           most_v = hn::Set(d, static_cast<float>(warp.height - 1) - 1e-3f);
  for (int x = begin; x < end; x += lanes()) {
    const VF number = hn::Iota(d, 0.0f);
    const auto linear = [&](double start, double step) HWY_ATTR {
      return hn::Add(hn::Set(d, static_cast<float>(start + step * x)),
                     hn::Mul(number, hn::Set(d, static_cast<float>(step))));
    };
    const VF w = linear(warp.w_0, warp.w_step);
    const VF u = hn::Min(hn::Max(hn::Div(linear(warp.u_0, warp.u_step), w), hn::Zero(d)), most_u);
    const VF v = hn::Min(hn::Max(hn::Div(linear(warp.v_0, warp.v_step), w), hn::Zero(d)), most_v);
    const VI column = hn::ConvertTo(di, u), row = hn::ConvertTo(di, v);
    const VF fu = hn::Sub(u, hn::ConvertTo(d, column)), fv = hn::Sub(v, hn::ConvertTo(d, row));
    const VI at = hn::Add(column, hn::Mul(row, stride));
    const VI a = hn::GatherIndex(di, pixels, at), b = hn::GatherIndex(di, pixels, hn::Add(at, one)),
             e = hn::GatherIndex(di, pixels, hn::Add(at, stride)),
             f = hn::GatherIndex(di, pixels, hn::Add(hn::Add(at, stride), one));
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
    const int count = end - x < lanes() ? end - x : lanes();
    for (int n = 0; n < count; ++n)
      for (int c = 0; c < 3; ++c) rgb[3 * (x + n) + c] = bytes[c][n];
    if (hn::AllFalse(d, hn::Gt(apart, hn::Set(d, kEdge)))) continue;
    HWY_ALIGN float aparts[kChunk];
    hn::Store(apart, d, aparts);
    for (int n = 0; n < count; ++n)
      if (aparts[n] > kEdge) edges[edge_count++] = x + n;
  }
  return edge_count;
}

}  // namespace palpate::internal::volume_picture::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace palpate::internal::volume_picture {

HWY_EXPORT(light_blocks);
HWY_EXPORT(gather_line);
HWY_EXPORT(pack_line);
HWY_EXPORT(warp_row);
HWY_EXPORT(trace_rays);

void light_blocks(const VoxelBlock* voxels, const std::uint32_t* which, std::size_t count,
                  const LightFall& light, LitBlock* lit) {
  HWY_DYNAMIC_DISPATCH(light_blocks)(voxels, which, count, light, lit);
}
void gather_line(const RowsView& rows, const SamplePlane* planes, int plane_count, int v, int width,
                 const Gathered& line) {
  HWY_DYNAMIC_DISPATCH(gather_line)(rows, planes, plane_count, v, width, line);
}
void pack_line(const Gathered& line, int width, const float* background, std::uint32_t* packed) {
  HWY_DYNAMIC_DISPATCH(pack_line)(line, width, background, packed);
}
int warp_row(const Warp& warp, int begin, int end, std::uint8_t* rgb, std::int32_t* edges) {
  return HWY_DYNAMIC_DISPATCH(warp_row)(warp, begin, end, rgb, edges);
}
void trace_rays(const RowsView& rows, const LeapsView& leaps, const PlaneRange& planes, int count,
                const TracedRays& rays) {
  HWY_DYNAMIC_DISPATCH(trace_rays)(rows, leaps, planes, count, rays);
}

}  // namespace palpate::internal::volume_picture
#endif  // HWY_ONCE
