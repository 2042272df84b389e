#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "palpate/volume/volume.h"

/// Inner loops of section rendering, compiled for every SIMD target and called by SectionRenderer.
namespace palpate::internal::section {

/// Grey values outside the scan, and without a scan.
inline constexpr std::uint8_t kOutsideScan = 14, kNoScan = 26;

/// Voxels of a brick along an axis. Bricks overlap by one voxel, so that the eight voxels around any point
/// lie in one brick: at corner, corner + 1, corner + stride.
inline constexpr int kBrick = 8, kBrickStep = kBrick - 1, kBrickVoxels = kBrick * kBrick * kBrick;
/// Largest dimension for which division by kBrickStep can be done by multiplication (section_simd.cc).
inline constexpr int kMaxVoxelsAlongBricks = 8192;

/// Memory layout: the offset of voxel q is the sum over the axes of q * stride + q / kBrickStep * jump.
struct Lattice {
  int dims[3]{};
  std::int32_t stride[3]{};
  std::int32_t jump[3]{};  ///< 0 without bricks
};

/// Volumes of a model, either in the model or in bricks; null if missing.
struct VolumeView {
  Lattice lattice;
  bool bricks = false;
  const float* scan = nullptr;           ///< Without bricks
  const std::uint16_t* codes = nullptr;  ///< In bricks: quantised scan, 0 for values that are not finite
  bool has_holes = false;                ///< Whether any code is 0
  const LabelId* labels = nullptr;
  const std::uint8_t* numbers = nullptr;  ///< In bricks: indices of labels, if these fit in a byte
  const LabelId* label_of_number = nullptr;
};

/// Mapping of scan values or codes to grey: (value - zero) * per_value, clamped to 0 ... top and rounded to
/// the nearest level.
struct GreyScale {
  float zero = 0, per_value = 1, top = 255;
};

/// Row of a picture: continuous voxel index of its first pixel, and the range of pixels inside the volume.
struct Row {
  double start[3]{};
  int begin = 0, end = 0;
};
/// All rows, and the step of the continuous index per pixel.
struct Rows {
  const Row* row = nullptr;
  int count = 0, width = 0;
  double step[3]{};
};

/// Rows of a picture that are sampled together, with the output per pixel; there is room for kPixelPadding
/// extra pixels before and after every row.
inline constexpr int kBandRows = 64, kPixelPadding = 64;
struct Band {
  int first = 0, count = 0;  ///< Rows of the picture
  std::ptrdiff_t stride = 0;
  std::uint8_t* grey = nullptr;  ///< First row of the band
  LabelId* labels = nullptr;
};

/// Colour and opacity of a structure's inside [2 * label] and outline [2 * label + 1].
using Paint = std::array<std::uint8_t, 4>;

/// Fills grey (if there is a scan) and labels (if there are any) of the pixels inside the volume. Pixels to
/// their right in the same row may be overwritten. Also prefetches for the next band.
void sample(const VolumeView& volume, const GreyScale& scale, const Rows& rows, const Band& band);

/// Converts grey to RGB: 3 * width bytes of a row.
void grey_row(const std::uint8_t* grey, int width, std::uint8_t* rgb);

/// Blends structures over grey: 3 * width bytes of a row. `above` and `below` are the labels of the
/// neighbouring rows, or the row's own. Reads one label beyond either end of `labels`.
void blend_row(const Paint* paints, const std::uint8_t* grey, const LabelId* labels, const LabelId* above,
               const LabelId* below, int width, std::uint8_t* rgb);

}  // namespace palpate::internal::section
