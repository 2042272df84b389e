#pragma once

#include <array>
#include <atomic>
#include <memory>
#include <string>

#include "palpate/volume/bricks.h"

/// Voxels in wire format: docs/reference/viewer-http.md, "Volumes". Little-endian, i fastest, then j,
/// then k.
namespace palpate::server {

/// Quantisation of a scan to 16-bit integers: value = offset + scale * voxel. Lossless if the scan holds
/// integers that span at most 16 bits, as CT and most MR do; otherwise accurate to half of 1/65535 of its
/// range.
struct ScanScale {
  double scale = 1, offset = 0;
  std::array<double, 2> range{0, 0};  ///< Range of the finite voxels; both 0 if there are none

  static ScanScale of(const Volume<float>& scan);
  /// Quantises a value; NaN and values below the range become the minimum, values above it the maximum.
  std::int16_t quantise(double value) const;
};

/// Whether a label exceeds 255, so that a voxel takes two bytes.
bool needs_wide_labels(const Bricks<LabelId>& labels);

/// dims / shrink, rounded up.
std::array<int, 3> shrunk_dims(const std::array<int, 3>& dims, int shrink);

/// Scan as means over blocks of `shrink`^3 voxels, of those that are finite and inside the grid. Null if
/// `stop` became true in the meantime.
/// @param shrink  1, 2 or 4
std::shared_ptr<const std::string> scan_payload(const Volume<float>& scan, const ScanScale& scale, int shrink,
                                                const std::atomic<bool>& stop);

/// Labels: the most frequent one of each block, in a tie the lowest above 0. `stop` as above.
std::shared_ptr<const std::string> labels_payload(const Bricks<LabelId>& labels, bool wide, int shrink,
                                                  const std::atomic<bool>& stop);

/// Bytes as a gzip stream. `stop` as above.
/// @param level  zlib's compression level
std::shared_ptr<const std::string> gzip(const std::string& bytes, const std::atomic<bool>& stop,
                                        int level = 6);

}  // namespace palpate::server
