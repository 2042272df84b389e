#include "rendering/section_simd.h"

// A picture is sampled in tiles, because neighbouring rows read the same cache lines. Each row of a tile
// passes three loops, each short enough for out-of-order execution across many pixels:
//
//     cells     position of each pixel: first voxel of its cell, fractions within the cell, nearest voxel
//     voxels    loads the cell's eight voxels and the nearest one's label: scalar loads beat gathers
//     greys     trilinear interpolation and window
//
// The cache lines of the next tile are prefetched; a line that is not prefetched stalls. Within a tile's row,
// positions relative to its first pixel are in float, the first pixel's in double. No fused operations are
// used: bit-identical on every target.
//
// Compiled once per target by foreach_target.h; only functions marked HWY_INLINE and those at the end are in
// the target's namespace, and none of them calls the standard library.

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "rendering/section_simd.cc"
#include <hwy/foreach_target.h>
// after foreach_target.h
#include <hwy/cache_control.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace palpate::internal::section::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

using DF = hn::ScalableTag<float>;
using DI = hn::RebindToSigned<DF>;
using VF = hn::Vec<DF>;
using VI = hn::Vec<DI>;

constexpr int kTileColumns = 64, kTileRows = 64;
static_assert(kBandRows % kTileRows == 0);
constexpr int kBrickRow = kBrick, kBrickSlice = kBrick * kBrick;
constexpr int kMaxLanes = 16;
static_assert(HWY_MAX_BYTES <= 4 * kMaxLanes || HWY_TARGET == HWY_SCALAR);

/// A tile's row of pixels between the loops.
struct alignas(64) Cells {
  static constexpr int kRoom = kTileColumns + kMaxLanes;
  float fraction[3][kRoom];
  std::int32_t corner[kRoom], nearest[kRoom];
};
/// Pairs of codes along i, at (j, k), (j + 1, k), (j, k + 1), (j + 1, k + 1).
struct alignas(64) CodePairs {
  std::int32_t pair[4][Cells::kRoom];
};
/// The same as floats: first and second of each pair.
struct alignas(64) FloatPairs {
  float first[4][Cells::kRoom], second[4][Cells::kRoom];
};

// ---- cells ------------------------------------------------------------------------------------------------

/// Cells of pixels at start, start + step, ...; positions outside are clamped to the border.
template <bool kBricks>
HWY_INLINE void find_cells(const Lattice& lattice, const double (&start)[3], const double (&step)[3],
                           int count, Cells& cells) {
  const DF d;
  const DI di;
  const auto half = hn::Set(d, 0.5f);
  for (int n = 0; n < count; n += static_cast<int>(hn::Lanes(d))) {
    const VF number = hn::Iota(d, static_cast<float>(n));
    VI corner = hn::Zero(di), to_nearest = hn::Zero(di);
    for (int a = 0; a < 3; ++a) {
      const int last = lattice.dims[a] - 1, last_cell = last > 0 ? last - 1 : 0;
      VF x = hn::Add(hn::Set(d, static_cast<float>(start[a])),
                     hn::Mul(number, hn::Set(d, static_cast<float>(step[a]))));
      x = hn::Min(hn::Max(x, hn::Zero(d)), hn::Set(d, static_cast<float>(last)));
      const VI cell = hn::Min(hn::ConvertTo(di, x), hn::Set(di, last_cell));
      const VF fraction = hn::Sub(x, hn::ConvertTo(d, cell));
      hn::Store(fraction, d, cells.fraction[a] + n);
      const VI stride = hn::Set(di, lattice.stride[a]);
      corner = hn::Add(corner, hn::Mul(cell, stride));
      if constexpr (kBricks) {
        // exact up to 13 107: 7 * 9363 is 65 536 + 5
        const VI brick = hn::ShiftRight<16>(hn::Mul(cell, hn::Set(di, 65536 / kBrickStep + 1)));
        corner = hn::Add(corner, hn::Mul(brick, hn::Set(di, lattice.jump[a])));
      }
      const auto further = hn::RebindMask(di, hn::Ge(fraction, half));
      to_nearest = hn::Add(to_nearest, hn::IfThenElseZero(further, stride));
    }
    hn::Store(corner, di, cells.corner + n);
    hn::Store(hn::Add(corner, to_nearest), di, cells.nearest + n);
  }
}

// ---- voxels -----------------------------------------------------------------------------------------------

/// Loads the cell's eight voxels.
HWY_INLINE void load_corners(const VolumeView& volume, std::ptrdiff_t corner, int n, CodePairs& pairs) {
  const std::uint16_t* voxel = volume.codes + corner;
  hwy::CopyBytes<4>(voxel, &pairs.pair[0][n]);
  hwy::CopyBytes<4>(voxel + kBrickRow, &pairs.pair[1][n]);
  hwy::CopyBytes<4>(voxel + kBrickSlice, &pairs.pair[2][n]);
  hwy::CopyBytes<4>(voxel + kBrickSlice + kBrickRow, &pairs.pair[3][n]);
}
HWY_INLINE void load_corners(const VolumeView& volume, std::ptrdiff_t corner, int n, FloatPairs& pairs) {
  // a volume one voxel thick has no second voxel along that axis
  const Lattice& lattice = volume.lattice;
  const std::ptrdiff_t next = lattice.dims[0] > 1 ? 1 : 0, row = lattice.dims[1] > 1 ? lattice.stride[1] : 0,
                       slice = lattice.dims[2] > 1 ? lattice.stride[2] : 0;
  for (int m = 0; m < 4; ++m) {
    const float* first = volume.scan + corner + (m & 1) * row + (m >> 1) * slice;
    pairs.first[m][n] = first[0];
    pairs.second[m][n] = first[next];
  }
}

/// Scan and labels in one loop, so that the cache misses of both overlap.
template <bool kScan, class Pairs, class Label>
HWY_INLINE void load_voxels(const VolumeView& view, const Cells& cells, int count, Pairs& pairs,
                            LabelId* labels, const Label& label) {
  const VolumeView volume = view;
  for (int n = 0; n < count; ++n) {
    if constexpr (kScan) load_corners(volume, cells.corner[n], n, pairs);
    if (labels != nullptr) labels[n] = label(cells.nearest[n]);
  }
}

template <bool kScan, class Pairs>
HWY_INLINE void load_voxels(const VolumeView& volume, const Cells& cells, int count, Pairs& pairs,
                            LabelId* labels) {
  if (volume.numbers != nullptr) {
    const std::uint8_t* numbers = volume.numbers;
    const LabelId* label_of_number = volume.label_of_number;
    load_voxels<kScan>(volume, cells, count, pairs, labels,
                       [=](std::int32_t voxel) HWY_ATTR { return label_of_number[numbers[voxel]]; });
  } else {
    const LabelId* voxels = volume.labels;
    load_voxels<kScan>(volume, cells, count, pairs, voxels != nullptr ? labels : nullptr,
                       [=](std::int32_t voxel) HWY_ATTR { return voxels[voxel]; });
  }
}

// ---- greys ------------------------------------------------------------------------------------------------

HWY_INLINE VF lerp(VF a, VF b, VF t) {
  return hn::Add(a, hn::Mul(t, hn::Sub(b, a)));
}

/// Interpolates a pair along i.
HWY_INLINE VF along_i(const CodePairs& pairs, int m, int n, VF t) {
  const DI di;
  const VI pair = hn::Load(di, pairs.pair[m] + n);
  const VI first = hn::And(pair, hn::Set(di, 0xffff));
  const VI second = hn::And(hn::ShiftRight<16>(pair), hn::Set(di, 0xffff));
  return lerp(hn::ConvertTo(DF(), first), hn::ConvertTo(DF(), second), t);
}
HWY_INLINE VF along_i(const FloatPairs& pairs, int m, int n, VF t) {
  return lerp(hn::Load(DF(), pairs.first[m] + n), hn::Load(DF(), pairs.second[m] + n), t);
}

/// Whether all eight voxels are finite.
HWY_INLINE hn::Mask<DF> is_finite(const VolumeView& volume, const CodePairs& pairs, int n, VF) {
  const DI di;
  auto hole = hn::FirstN(di, 0);
  if (volume.has_holes) {
    for (const auto& row : pairs.pair) {
      const VI pair = hn::Load(di, row + n);
      hole = hn::Or(hole, hn::Eq(hn::And(pair, hn::Set(di, 0xffff)), hn::Zero(di)));
      hole = hn::Or(hole, hn::Eq(hn::ShiftRight<16>(pair), hn::Zero(di)));
    }
  }
  return hn::RebindMask(DF(), hn::Not(hole));
}
HWY_INLINE hn::Mask<DF> is_finite(const VolumeView&, const FloatPairs&, int, VF value) {
  // NaN and infinity propagate through sums, zero times infinity included
  return hn::Lt(hn::Abs(value), hn::Inf(DF()));
}

template <class Pairs>
HWY_INLINE void write_greys(const VolumeView& volume, const GreyScale& scale, const Cells& cells,
                            const Pairs& pairs, int count, std::uint8_t* grey) {
  const DF d;
  const DI di;
  const hn::Rebind<std::uint8_t, DF> d8;
  const auto half = hn::Set(d, 0.5f), top = hn::Set(d, scale.top);
  for (int n = 0; n < count; n += static_cast<int>(hn::Lanes(d))) {
    const VF i = hn::Load(d, cells.fraction[0] + n), j = hn::Load(d, cells.fraction[1] + n),
             k = hn::Load(d, cells.fraction[2] + n);
    const VF near = lerp(along_i(pairs, 0, n, i), along_i(pairs, 1, n, i), j);
    const VF far = lerp(along_i(pairs, 2, n, i), along_i(pairs, 3, n, i), j);
    const VF value = lerp(near, far, k);

    const auto finite = is_finite(volume, pairs, n, value);
    VF level = hn::Mul(hn::Sub(value, hn::Set(d, scale.zero)), hn::Set(d, scale.per_value));
    level = hn::Min(hn::Max(hn::IfThenElseZero(finite, level), hn::Zero(d)), top);
    level = hn::Add(level, half);
    // fewer than 256 levels are spread uniformly; the quotient is exact where it is a half
    if (scale.top != 255) {
      level = hn::ConvertTo(d, hn::ConvertTo(di, level));
      level = hn::Add(hn::Div(hn::Mul(level, hn::Set(d, 255)), top), half);
    }
    const auto byte =
        hn::IfThenElse(hn::RebindMask(di, finite), hn::ConvertTo(di, level), hn::Set(di, kOutsideScan));
    hn::StoreU(hn::DemoteTo(d8, byte), d8, grey + n);
  }
}

// ---- tiles ------------------------------------------------------------------------------------------------

struct Tile {
  int row, column;
};

/// Part of a row within a tile.
struct Piece {
  HWY_INLINE Piece(const Rows& rows, int y, int column) {
    const Row& row = rows.row[y];
    begin = row.begin > column ? row.begin : column;
    end = row.end < column + kTileColumns ? row.end : column + kTileColumns;
    for (int a = 0; a < 3; ++a) start[a] = row.start[a] + rows.step[a] * begin;
  }
  int begin, end;
  double start[3];  ///< continuous index at `begin`
};

/// Prefetches the cache lines around every second pixel in each direction: a cell's rows may lie in four
/// lines.
HWY_INLINE void prefetch(const VolumeView& volume, const Rows& rows, const Tile& tile) {
  constexpr int kApart = 2;
  Cells cells;
  const double step[3] = {kApart * rows.step[0], kApart * rows.step[1], kApart * rows.step[2]};
  for (int y = tile.row; y < tile.row + kTileRows && y < rows.count; y += kApart) {
    const Piece piece(rows, y, tile.column);
    if (piece.begin >= piece.end) continue;
    const int count = (piece.end - piece.begin + kApart - 1) / kApart;
    find_cells<true>(volume.lattice, piece.start, step, count, cells);
    for (int n = 0; n < count; ++n) {
      if (volume.codes != nullptr) {
        const std::uint16_t* corner = volume.codes + cells.corner[n];
        hwy::Prefetch(corner);
        hwy::Prefetch(corner + kBrickRow);
        hwy::Prefetch(corner + kBrickSlice);
        hwy::Prefetch(corner + kBrickSlice + kBrickRow);
      }
      if (volume.labels != nullptr) hwy::Prefetch(volume.labels + cells.nearest[n]);
      if (volume.numbers != nullptr) hwy::Prefetch(volume.numbers + cells.nearest[n]);
    }
  }
}

template <bool kBricks, class Pairs>
HWY_INLINE void sample_tile(const VolumeView& volume, const GreyScale& scale, const Rows& rows,
                            const Band& band, const Tile& tile) {
  const bool has_scan = kBricks ? volume.codes != nullptr : volume.scan != nullptr;
  constexpr int kLanes = static_cast<int>(hn::MaxLanes(DF()));
  Cells cells;
  Pairs pairs;
  for (int y = tile.row; y < tile.row + kTileRows && y < band.first + band.count; ++y) {
    const Piece piece(rows, y, tile.column);
    if (piece.begin >= piece.end) continue;
    const int count = piece.end - piece.begin, padded = (count + kLanes - 1) / kLanes * kLanes;
    find_cells<kBricks>(volume.lattice, piece.start, rows.step, count, cells);
    const std::ptrdiff_t first = (y - band.first) * band.stride + piece.begin;
    if (has_scan) {
      load_voxels<true>(volume, cells, padded, pairs, band.labels + first);
      write_greys(volume, scale, cells, pairs, count, band.grey + first);
    } else {
      load_voxels<false>(volume, cells, padded, pairs, band.labels + first);
    }
  }
}

template <bool kBricks, class Pairs>
HWY_INLINE void sample_tiles(const VolumeView& volume, const GreyScale& scale, const Rows& rows,
                             const Band& band) {
  // the first tile of every later band was prefetched by the band before
  if (kBricks && band.first == 0) prefetch(volume, rows, {0, 0});
  for (int row = band.first; row < band.first + band.count; row += kTileRows) {
    for (int column = 0; column < rows.width; column += kTileColumns) {
      if constexpr (kBricks) {
        const bool last = column + kTileColumns >= rows.width;
        prefetch(volume, rows, last ? Tile{row + kTileRows, 0} : Tile{row, column + kTileColumns});
      }
      sample_tile<kBricks, Pairs>(volume, scale, rows, band, {row, column});
    }
  }
}

void sample_bricks(const VolumeView& volume, const GreyScale& scale, const Rows& rows, const Band& band) {
  sample_tiles<true, CodePairs>(volume, scale, rows, band);
}
void sample_plain(const VolumeView& volume, const GreyScale& scale, const Rows& rows, const Band& band) {
  sample_tiles<false, FloatPairs>(volume, scale, rows, band);
}

// ---- structures over grey
// ----------------------------------------------------------------------------------

using D16 = hn::ScalableTag<std::uint16_t>;
using D8 = hn::Rebind<std::uint8_t, D16>;
using V16 = hn::Vec<D16>;
using V8 = hn::Vec<D8>;

/// (under * (255 - alpha) + over * alpha) / 255, rounded to the nearest.
HWY_INLINE V8 blended(V16 under, V8 over, V16 alpha) {
  const D16 d;
  const V16 rest = hn::Sub(hn::Set(d, 255), alpha);
  const V16 sum =
      hn::Add(hn::Add(hn::Mul(under, rest), hn::Mul(hn::PromoteTo(d, over), alpha)), hn::Set(d, 127));
  // exact below 65 535
  const V16 quotient = hn::ShiftRight<8>(hn::Add(hn::Add(sum, hn::Set(d, 1)), hn::ShiftRight<8>(sum)));
  return hn::DemoteTo(D8(), hn::BitCast(hn::RebindToSigned<D16>(), quotient));
}

/// Number of pixels blended together: large enough that the stores of each lane's paint have completed before
/// they are loaded.
constexpr int kBlock = 64;
static_assert(HWY_MAX_BYTES <= 2 * kBlock || HWY_TARGET == HWY_SCALAR);

/// Sets 1 for pixels whose label differs from any of the four neighbours. Returns whether any structure is
/// visible.
HWY_INLINE bool find_outlines(const LabelId* labels, const LabelId* above, const LabelId* below, int count,
                              std::uint16_t* outline) {
  const D16 d;
  auto any = hn::Zero(d);
  for (int x = 0; x < count; x += static_cast<int>(hn::Lanes(d))) {
    const V16 label = hn::LoadU(d, labels + x);
    const auto same = hn::And(
        hn::And(hn::Eq(label, hn::LoadU(d, labels + x - 1)), hn::Eq(label, hn::LoadU(d, labels + x + 1))),
        hn::And(hn::Eq(label, hn::LoadU(d, above + x)), hn::Eq(label, hn::LoadU(d, below + x))));
    hn::Store(hn::IfThenZeroElse(same, hn::Set(d, 1)), d, outline + x);
    any = hn::Or(any, label);
  }
  return !hn::AllTrue(d, hn::Eq(any, hn::Zero(d)));
}

/// Up to kBlock pixels, written in whole vectors.
HWY_INLINE void grey_block(const std::uint8_t* grey, int count, std::uint8_t* rgb) {
  const D8 d8;
  for (int x = 0; x < count; x += static_cast<int>(hn::Lanes(d8))) {
    const V8 under = hn::LoadU(d8, grey + x);
    hn::StoreInterleaved3(under, under, under, d8, rgb + 3 * x);
  }
}

/// The same with structures over it.
HWY_INLINE void blend_block(const Paint* paints, const std::uint8_t* grey, const LabelId* labels,
                            const LabelId* above, const LabelId* below, int count, std::uint8_t* rgb) {
  const D16 d;
  const D8 d8;
  constexpr int kLanes = static_cast<int>(hn::MaxLanes(d));
  alignas(64) std::uint16_t outline[kBlock];
  alignas(64) std::uint8_t paint[4 * kBlock];
  if (!find_outlines(labels, above, below, count, outline)) return grey_block(grey, count, rgb);
  const int padded = (count + kLanes - 1) / kLanes * kLanes;
  for (int x = 0; x < padded; ++x) hwy::CopyBytes<4>(&paints[2 * labels[x] + outline[x]], paint + 4 * x);
  for (int x = 0; x < count; x += kLanes) {
    V8 red, green, blue, alpha;
    hn::LoadInterleaved4(d8, paint + 4 * x, red, green, blue, alpha);
    const V16 under = hn::PromoteTo(d, hn::LoadU(d8, grey + x)), alpha16 = hn::PromoteTo(d, alpha);
    hn::StoreInterleaved3(blended(under, red, alpha16), blended(under, green, alpha16),
                          blended(under, blue, alpha16), d8, rgb + 3 * x);
  }
}

/// Writes a row in blocks: block(x, count, rgb) may write whole vectors.
template <class Block>
HWY_INLINE void write_row(int width, std::uint8_t* rgb, const Block& block) {
  int x = 0;
  for (; x + kBlock <= width; x += kBlock) block(x, kBlock, rgb + 3 * x);
  if (x == width) return;
  alignas(64) std::uint8_t last[3 * kBlock];
  block(x, width - x, last);
  for (int n = 0; n < 3 * (width - x); ++n) rgb[3 * x + n] = last[n];
}

void grey_row(const std::uint8_t* grey, int width, std::uint8_t* rgb) {
  write_row(width, rgb,
            [=](int x, int count, std::uint8_t* to) HWY_ATTR { grey_block(grey + x, count, to); });
}

void blend_row(const Paint* paints, const std::uint8_t* grey, const LabelId* labels, const LabelId* above,
               const LabelId* below, int width, std::uint8_t* rgb) {
  write_row(width, rgb, [=](int x, int count, std::uint8_t* to) HWY_ATTR {
    blend_block(paints, grey + x, labels + x, above + x, below + x, count, to);
  });
}

}  // namespace palpate::internal::section::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace palpate::internal::section {

HWY_EXPORT(sample_bricks);
HWY_EXPORT(sample_plain);
HWY_EXPORT(grey_row);
HWY_EXPORT(blend_row);

void sample(const VolumeView& volume, const GreyScale& scale, const Rows& rows, const Band& band) {
  if (volume.bricks) {
    HWY_DYNAMIC_DISPATCH(sample_bricks)(volume, scale, rows, band);
  } else {
    HWY_DYNAMIC_DISPATCH(sample_plain)(volume, scale, rows, band);
  }
}
void grey_row(const std::uint8_t* grey, int width, std::uint8_t* rgb) {
  HWY_DYNAMIC_DISPATCH(grey_row)(grey, width, rgb);
}
void blend_row(const Paint* paints, const std::uint8_t* grey, const LabelId* labels, const LabelId* above,
               const LabelId* below, int width, std::uint8_t* rgb) {
  HWY_DYNAMIC_DISPATCH(blend_row)(paints, grey, labels, above, below, width, rgb);
}

}  // namespace palpate::internal::section
#endif  // HWY_ONCE
