#pragma once

#include <cstddef>
#include <cstdint>

#include "palpate/sampling/voxel_methods.h"

namespace palpate::internal::stored_normals {

/// A voxel is a little-endian number: the magnitude in its lowest 8 bits, then the normal:
///
///     bytes           x:8 y:8 z:8                 each of 127
///     octahedral 16   a:8 b:8                     each of 127
///     octahedral 24   a:12 b:12                   each of 2047
///
/// all of them signed. The least number (-128, -2048) occurs in no octahedral code; as a it means no normal.
/// Three zero bytes mean it without that.
struct StoredGrid {
  const std::uint8_t* cell;  ///< voxel (0, 0, 0) inside its border of one voxel
  std::int32_t stride[3];    ///< bytes from a voxel to the next along i, j, k
  int dims[3];               ///< without the border
  float mm_of_voxel[3][3];   ///< column a: one voxel along axis a, in millimetres
  NormalEncoding encoding;
};

/// A point in continuous voxel indices.
struct StoredPoint {
  double x[3];
};

/// The same bits on every target, and whatever the number of points. Each voxel is read as 4 bytes. Samples
/// are written as four doubles each: the value, then minus the normal, unit or 0.
void sample_stored(const StoredGrid& grid, const StoredPoint* points, std::size_t count, double* samples);

}  // namespace palpate::internal::stored_normals
