#pragma once

#include <cstddef>
#include <cstdint>

#include "palpate/sampling/stored_normals.h"

namespace palpate::internal::stored_normals {

/// A voxel is a little-endian number: the magnitude in the lowest 8 bits, then the signed numbers of the
/// normal:
///
///     bytes           x:8 y:8 z:8                 each of 127
///     octahedral 16   a:8 b:8                     each of 127
///     octahedral 24   a:12 b:12                   each of 2047
///
/// In octahedral encodings the minimum number (-128, -2048) as a means no normal, because no code has it.
/// With kBytes no normal is three zero bytes.
struct StoredGrid {
  const std::uint8_t* cell;  ///< Voxel (0, 0, 0) inside the border of one voxel
  std::int32_t stride[3];    ///< Bytes from a voxel to the next along i, j, k
  int dims[3];               ///< Dimensions without the border
  float mm_of_voxel[3][3];   ///< Column a: displacement in mm of one voxel along axis a
  NormalEncoding encoding;
};

/// Point in continuous voxel coordinates.
struct StoredPoint {
  double x[3];
};

/// Samples stored normals; bit-identical on every target and for any number of points. Each voxel is read as
/// 4 bytes. Each sample is four doubles: the value, then minus the normal, unit or 0.
void sample_stored(const StoredGrid& grid, const StoredPoint* points, std::size_t count, double* samples);

}  // namespace palpate::internal::stored_normals
