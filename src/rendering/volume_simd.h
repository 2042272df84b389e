#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>

/// The inner loops of a volume's picture, compiled for every SIMD target; VolumeRenderer prepares and calls
/// them.
namespace palpate::internal::volume_picture {

/// Voxels of a block, along its row.
inline constexpr int kBlock = 8;
/// Extinction, and extinction times light, are kept as whole numbers: times h, in steps of 1 / 8192.
inline constexpr float kDepthSteps = 8192;
/// Of a normal's components.
inline constexpr float kNormalSteps = 127;

struct alignas(64) VoxelBlock {
  std::uint16_t extinction[kBlock];
  std::uint8_t colour[3][kBlock];
  std::int8_t normal[3][kBlock];  ///< patient
};
/// Extinction times red and, in the upper half, green light; times blue light and, in the upper half, alone.
struct alignas(64) LitBlock {
  std::uint32_t pair[2][kBlock];
};
static_assert(sizeof(VoxelBlock) == 64 && sizeof(LitBlock) == 64);

/// How light falls: away from the viewer, and VolumeLight.
struct LightFall {
  float into[3];
  float ambient, diffuse, specular;
};

/// What a thread has lit last, so much as its own cache holds: a block is met again on the next plane and by
/// the next lines, and lighting it anew takes less time than fetching all that was ever lit from memory. A
/// block lies where its place says, and is lit anew where another one took that.
struct alignas(64) LitBlocks {
  static constexpr std::uint32_t kCount = 4096;
  LitBlock lit[kCount];
  std::uint32_t place[kCount];

  /// For another light, or other blocks. Place 0 is the empty block: nothing comes from it.
  void forget() {
    lit[0] = {};
    std::fill_n(place, kCount, 0u);
  }
};

/// Blocks of a row whose places follow each other, those that are there: so a row of 512 voxels is found by 8
/// numbers and 64 bits, which stay in a cache where a number for each block would not.
inline constexpr int kGroup = 8;

/// Where a block of a row lies; 0: it is not there.
inline std::uint32_t place_of(const std::uint64_t* mask, const std::uint32_t* first, int block) {
  const auto group = static_cast<std::uint32_t>(mask[block / 64] >> (block % 64 / kGroup * kGroup) & 0xff),
             bit = 1u << block % kGroup;
  if ((group & bit) == 0) return 0;
  return first[block / kGroup] + static_cast<std::uint32_t>(std::popcount(group & (bit - 1)));
}

/// Rows of blocks, seen along an axis: x along a row, z away from the viewer or towards it.
struct RowsView {
  const std::uint64_t* mask = nullptr;  ///< a bit for each block that is there; `words` a row
  const std::uint32_t* first =
      nullptr;  ///< where the first of each group of kGroup that is there lies; `groups` a row
  const VoxelBlock* voxels = nullptr;  ///< the first one is empty
  LightFall light{};
  int blocks = 0, words = 0, groups = 0;
  int count[3]{};           ///< voxels along x, y, z
  std::ptrdiff_t row[3]{};  ///< from a row to the next along y and z; [0] is not used
};

/// A plane of samples: intermediate pixel (u, v) is sampled at x = x_per_u u + x_0, y = y_per_v v + y_0.
struct SamplePlane {
  double x_per_u, x_0, y_per_v, y_0;
  double u_per_x;  ///< 1 / x_per_u
  int slice;       ///< z is there, and
  float beyond;    ///< so much farther along the axis, 0 ... 1
};

/// What a line of intermediate pixels has gathered; arrays of whole chunks of kChunk.
inline constexpr int kChunk = 8;
struct Gathered {
  float* channel[3];  ///< 0 ... 1
  float* clear;       ///< how much of what lies behind is seen
  float* met;         ///< plane at which it fell below one half, and parts of one; -1: nowhere; may be null
  float* begun;       ///< the first plane on which there is anything; kNoPlane: none
  float* step;        ///< from plane to plane, h
  float* first;       ///< planes that are seen, and parts of one; null: all
  float* last;
  std::uint64_t* open;  ///< a bit for each chunk: something more is seen
};
inline constexpr float kNoPlane = 1e9f;
/// Lines that are gathered together, and rows of voxels, across the lines, that they have in common at most.
inline constexpr int kMostLines = 4, kMostRows = 6;
inline constexpr int kRowPadding = 32 * kBlock;
/// Room for rows of voxels, kRowPadding more at either end: red, green, blue and extinction of each; and the
/// thread's lit blocks.
struct MixingRoom {
  LitBlocks* lit;
  float* pair[kMostRows][4];
};

/// Gathers lines v ... v + count - 1 from all planes, front to back, on each plane one line after another:
/// lines that lie beside each other look at the same blocks. @param width  pixels
void gather_lines(const RowsView& rows, const SamplePlane* planes, int plane_count, int v, int count,
                  int width, const Gathered* lines, const MixingRoom& room);

/// Intermediate pixels: red, green and blue in 10 bits each. Whole chunks.
void pack_line(const Gathered& line, int width, const float* background, std::uint32_t* packed);

/// Copies whole chunks of a line of intermediate pixels and marks those at which the light bends by much
/// along the line, or across it.
/// @param above, below  the lines beside it; one pixel before and after `here` is read
inline constexpr std::uint32_t kBendsAlong = 0x80000000, kBendsAcross = 0x40000000;
void mark_line(const std::uint32_t* above, const std::uint32_t* here, const std::uint32_t* below, int width,
               std::uint32_t* marked);

/// Where there is nothing. Cell c lies between voxels c - 1 and c; of each cube of 4^3 cells is known which
/// of them have a voxel with something at a corner, and, where none has, how many cubes from here, itself
/// included, have none, whichever way one goes.
struct CubesView {
  const std::uint64_t* filled = nullptr;  ///< bit (i & 3) + 4 (j & 3) + 16 (k & 3) of the grid's axes
  const std::uint8_t* leap = nullptr;     ///< 0 where a bit is set
  std::int32_t step[3]{};                 ///< from a cube to the next along x, y, z of the rows
  int shift[3]{};                         ///< of a cell's place in a bit's number
};
inline constexpr int kCubeShift = 2, kCubeSide = 1 << kCubeShift;

/// A ray through planes of samples, front to back, and what it gathers.
struct TracedRay {
  float x, x_per_plane, y, y_per_plane;  ///< voxels, at plane 0
  float step;                            ///< from plane to plane, h
  float first, last;                     ///< planes that are seen, and parts of one
  float begun;                           ///< before this plane there is nothing
  float channel[3];                      ///< 0 ... 1
  float clear, met;                      ///< as in Gathered
};
/// @param wants_met  whether TracedRay::met is looked for
void trace_rays(const RowsView& rows, const CubesView& cubes, const SamplePlane* planes, int plane_count,
                float z_per_plane, bool wants_met, int count, TracedRay* rays, LitBlocks& lit);

/// Final pixels of a row from intermediate ones at (u, v) = (U, V) / W, all linear in the column.
struct Warp {
  const std::uint32_t* pixels;  ///< marked
  std::ptrdiff_t stride;
  int width, height;
  double u_0, u_step, v_0, v_step, w_0, w_step;
};
/// @param begin, end  columns
/// @param edges       takes the columns between whose four intermediate pixels there is an edge
/// @returns how many these are
int warp_row(const Warp& warp, int begin, int end, std::uint8_t* rgb, std::int32_t* edges);

}  // namespace palpate::internal::volume_picture
