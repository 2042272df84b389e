#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "palpate/volume/volume.h"

/// The inner loops of a section, compiled for every SIMD target; SectionRenderer prepares and calls them.
namespace palpate::internal::section {

/// What lies beyond the scan, and where there is none at all.
inline constexpr std::uint8_t kOutsideScan = 14, kNoScan = 26;

/// Voxels of a brick along an axis. Bricks overlap by one voxel, so that the eight voxels around any place
/// lie in one brick: at corner, corner + 1, corner + stride.
inline constexpr int kBrick = 8, kBrickStep = kBrick - 1, kBrickVoxels = kBrick * kBrick * kBrick;
/// Up to here dividing by kBrickStep is a multiplication (section_simd.cc).
inline constexpr int kMostVoxelsAlongBricks = 8192;

/// How voxels lie in memory: voxel q at the sum over axes of q * stride + q / kBrickStep * jump.
struct Lattice {
  int dims[3]{};
  std::int32_t stride[3]{};
  std::int32_t jump[3]{};  ///< 0 without bricks
};

/// The volumes of a model, either as they stand in it, or in bricks; null where there is none.
struct VolumeView {
  Lattice lattice;
  bool bricks = false;
  const float* scan = nullptr;           ///< without bricks
  const std::uint16_t* codes = nullptr;  ///< in bricks: the scan, 0 where it is not finite
  bool has_holes = false;                ///< some code is 0
  const LabelId* labels = nullptr;
  const std::uint8_t* numbers = nullptr;  ///< in bricks: labels, where they are few enough to be numbered
  const LabelId* label_of_number = nullptr;
};

/// From scan values, or codes, to grey: (value - zero) * per_value, 0 ... top, to the nearest level.
struct GreyScale {
  float zero = 0, per_value = 1, top = 255;
};

/// A picture's row: the continuous index of its first pixel, and the pixels that lie in the volume.
struct Row {
  double start[3]{};
  int begin = 0, end = 0;
};
/// All of them, and the continuous index from one pixel to the next.
struct Rows {
  const Row* row = nullptr;
  int count = 0, width = 0;
  double step[3]{};
};

/// Rows of a picture that are sampled in one go, and what is computed for each pixel; room for kPixelPadding
/// more before and after every row.
inline constexpr int kBandRows = 64, kPixelPadding = 64;
struct Band {
  int first = 0, count = 0;  ///< in the picture
  std::ptrdiff_t stride = 0;
  std::uint8_t* grey = nullptr;  ///< of the first row
  LabelId* labels = nullptr;
};

/// Colour and opacity of a structure's inside [2 * label] and outline [2 * label + 1].
using Paint = std::array<std::uint8_t, 4>;

/// Fills grey (where there is a scan) and labels (where there are any) of the pixels that lie in the volume.
/// Pixels of the same row to their right may be overwritten. Asks for what the next band reads, too.
void sample(const VolumeView& volume, const GreyScale& scale, const Rows& rows, const Band& band);

/// Greys alone: 3 * width bytes of a row.
void grey_row(const std::uint8_t* grey, int width, std::uint8_t* rgb);

/// Structures over grey: 3 * width bytes of a row. `above` and `below` are its neighbours' labels, or its
/// own. One label beyond either end of `labels` is read.
void blend_row(const Paint* paints, const std::uint8_t* grey, const LabelId* labels, const LabelId* above,
               const LabelId* below, int width, std::uint8_t* rgb);

}  // namespace palpate::internal::section
