#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>

/// Inner loops of volume rendering, compiled for every SIMD target and called by VolumeRenderer.
namespace palpate::internal::volume_picture {

/// Voxels of a block along its row.
inline constexpr int kBlock = 8;
/// Quantisation of extinction, and of extinction times radiance: in units of 1 / 8192 per h.
inline constexpr float kDepthSteps = 8192;
/// Quantisation of a normal's components.
inline constexpr float kNormalSteps = 127;

struct alignas(64) VoxelBlock {
  std::uint16_t extinction[kBlock];
  std::uint8_t colour[3][kBlock];
  std::int8_t normal[3][kBlock];  ///< Patient frame
};
/// First: extinction times red and, in the upper half, green radiance. Second: extinction times blue and, in
/// the upper half, extinction alone.
struct alignas(64) LitBlock {
  std::uint32_t pair[2][kBlock];
};
static_assert(sizeof(VoxelBlock) == 64 && sizeof(LitBlock) == 64);

/// Illumination: directions away from the viewer and away from the key light, patient frame, and VolumeLight.
struct Illumination {
  float into[3];
  float from_key[3];
  float ambient, diffuse, specular, key;
  float key_facing;  ///< Cosine between the key light and a surface that faces the viewer, at least 0
};

/// Direct-mapped cache of recently lit blocks, of the size of a thread's own CPU cache: a block is reused on
/// the next plane and by the next lines, and lighting it again takes less time than fetching it from main
/// memory. A block's slot is determined by its index; it is lit again if another block has taken the slot.
struct alignas(64) LitBlockCache {
  static constexpr std::uint32_t kCount = 4096;
  LitBlock lit[kCount];
  std::uint32_t index[kCount];

  /// Invalidates the cache, for another light or other blocks. Index 0 is the empty block, which contributes
  /// nothing.
  void forget() {
    lit[0] = {};
    std::fill_n(index, kCount, 0u);
  }
};

/// Number of blocks of a row in a group. The stored blocks of a group have consecutive indices: a row of 512
/// voxels is described by 8 numbers and 64 bits, which fit in the cache where a number per block would not.
inline constexpr int kGroup = 8;

/// Index of a block of a row; 0: not stored.
inline std::uint32_t slot_of(const std::uint64_t* mask, const std::uint32_t* first, int block) {
  const auto group = static_cast<std::uint32_t>(mask[block / 64] >> (block % 64 / kGroup * kGroup) & 0xff),
             bit = 1u << block % kGroup;
  if ((group & bit) == 0) return 0;
  return first[block / kGroup] + static_cast<std::uint32_t>(std::popcount(group & (bit - 1)));
}

/// Rows of blocks for a view: x along a row, z away from or towards the viewer.
struct RowsView {
  const std::uint64_t* mask = nullptr;  ///< Bit per stored block; `words` per row
  /// Index of the first stored block of each group of kGroup; `groups` per row
  const std::uint32_t* first = nullptr;
  const VoxelBlock* voxels = nullptr;  ///< Block 0 is empty
  Illumination light{};
  int blocks = 0, words = 0, groups = 0;
  int count[3]{};           ///< Voxels along x, y, z
  std::ptrdiff_t row[3]{};  ///< Distance between rows along y and z; [0] is unused
};

/// Sampling plane: intermediate pixel (u, v) is sampled at x = x_per_u u + x_0, y = y_per_v v + y_0.
struct SamplePlane {
  double x_per_u, x_0, y_per_v, y_0;
  double u_per_x;  ///< 1 / x_per_u
  int slice;       ///< Integer part of z
  float beyond;    ///< Fraction of z, 0 ... 1
};

/// Accumulated values of a line of intermediate pixels; arrays of whole chunks of kChunk.
inline constexpr int kChunk = 8;
struct AccumulatedLine {
  float* channel[3];  ///< 0 ... 1
  float* transmittance;
  float* half_plane;  ///< Plane, with fraction, at which transmittance fell below one half; -1: nowhere; may
                      ///< be null
  float* first_filled;  ///< First plane with non-zero extinction; kNoPlane: none
  float* step;          ///< Distance between planes, in units of h
  float* first;         ///< Range of visible planes, with fractions; null: all
  float* last;
  std::uint64_t* unfinished;  ///< Bit per chunk: some pixel is not opaque yet
};
inline constexpr float kNoPlane = 1e9f;
/// Maximum number of lines accumulated together, and of voxel rows that they share across the lines.
inline constexpr int kMaxLines = 4, kMaxRows = 6;
inline constexpr int kRowPadding = 32 * kBlock;
/// Scratch memory for voxel rows with kRowPadding at either end (red, green, blue and extinction of each),
/// and the thread's lit blocks.
struct MixingBuffers {
  LitBlockCache* lit;
  float* pair[kMaxRows][4];
};

/// Accumulates lines v ... v + count - 1 over all planes, front to back, with the lines interleaved on each
/// plane, because neighbouring lines use the same blocks.
/// @param width  pixels
void accumulate_lines(const RowsView& rows, const SamplePlane* planes, int plane_count, int v, int count,
                      int width, const AccumulatedLine* lines, const MixingBuffers& buffers);

/// Packs intermediate pixels: red, green and blue in 10 bits each. Whole chunks.
void pack_line(const AccumulatedLine& line, int width, const float* background, std::uint32_t* packed);

/// Marks of mark_line(): large second difference along the line, across it.
inline constexpr std::uint32_t kCreaseAlong = 0x80000000, kCreaseAcross = 0x40000000;
/// Copies whole chunks of a line of intermediate pixels and marks those with a large second difference along
/// the line or across it.
/// @param above, below  neighbouring lines; one pixel before and after `here` is read
void mark_line(const std::uint32_t* above, const std::uint32_t* here, const std::uint32_t* below, int width,
               std::uint32_t* marked);

/// Empty-space map. Cell c lies between voxels c - 1 and c; for each cube of 4^3 cells it stores which cells
/// have a non-empty voxel at a corner and, for an empty cube, the number of cubes, including itself, that are
/// empty in every direction.
struct CubesView {
  const std::uint64_t* filled = nullptr;  ///< Bit (i & 3) + 4 (j & 3) + 16 (k & 3), by the grid's axes
  const std::uint8_t* skip = nullptr;     ///< 0 if any bit is set
  std::int32_t step[3]{};                 ///< Distance between cubes along x, y, z of the rows
  int shift[3]{};                         ///< Shift of a cell's index within a bit's number
};
inline constexpr int kCubeShift = 2, kCubeSide = 1 << kCubeShift;

/// Ray through sampling planes, front to back, with its accumulated values.
struct TracedRay {
  float x, x_per_plane, y, y_per_plane;  ///< Voxel coordinates at plane 0, and steps
  float step;                            ///< Distance between planes, in units of h
  float first, last;                     ///< Range of visible planes, with fractions
  float first_filled;                    ///< Everything before this plane is empty
  float channel[3];                      ///< 0 ... 1
  float transmittance, half_plane;       ///< As in AccumulatedLine
};
/// @param wants_hits  whether TracedRay::half_plane is computed
void trace_rays(const RowsView& rows, const CubesView& cubes, const SamplePlane* planes, int plane_count,
                float z_per_plane, bool wants_hits, int count, TracedRay* rays, LitBlockCache& lit);

/// Resampling of final pixels of a row from intermediate ones at (u, v) = (U, V) / W, all linear in the
/// column.
struct Warp {
  const std::uint32_t* pixels;  ///< Marked by mark_line()
  std::ptrdiff_t stride;
  int width, height;
  double u_0, u_step, v_0, v_step, w_0, w_step;
};
/// @param begin, end  columns
/// @param edges       receives the columns whose four intermediate pixels contain an edge
/// @returns number of these columns
int warp_row(const Warp& warp, int begin, int end, std::uint8_t* rgb, std::int32_t* edges);

}  // namespace palpate::internal::volume_picture
