#pragma once

#include <array>
#include <atomic>
#include <memory>
#include <string>

#include "palpate/volume/bricks.h"

/// Voxels as viewers get them: docs/reference/viewer-http.md, "Volumes". Little-endian, i fastest, then j,
/// then k.
namespace palpate::link {

/// How a scan's values become whole numbers of 16 bits: value = offset + scale * voxel. Exact where the scan
/// holds whole numbers that span no more than 16 bits, as CT and most MR do; otherwise to within half of the
/// 65535th part of its range.
struct ScanScale {
  double scale = 1, offset = 0;
  std::array<double, 2> range{0, 0};  ///< of the finite voxels; both 0 where there are none

  static ScanScale of(const Volume<float>& scan);
  /// A value that is no number, and what lies below the range, becomes the lowest; what lies above, the
  /// highest.
  std::int16_t voxel(double value) const;
};

/// Whether a label is above 255, so that a voxel takes two bytes.
bool needs_wide_labels(const Bricks<LabelId>& labels);

/// dims / shrink, rounded up.
std::array<int, 3> shrunk_dims(const std::array<int, 3>& dims, int shrink);

/// The scan, means of `shrink`^3 voxels (those of a block that there are, and are finite). Nothing where
/// `stop` became true in the meantime.
/// @param shrink  1, 2 or 4
std::shared_ptr<const std::string> scan_payload(const Volume<float>& scan, const ScanScale& scale, int shrink,
                                                const std::atomic<bool>& stop);

/// The labels, of each block the most frequent one, of equals the lowest above 0. `stop` as above.
std::shared_ptr<const std::string> labels_payload(const Bricks<LabelId>& labels, bool wide, int shrink,
                                                  const std::atomic<bool>& stop);

/// The bytes as a gzip stream. `stop` as above. @param level  zlib's
std::shared_ptr<const std::string> gzip(const std::string& bytes, const std::atomic<bool>& stop,
                                        int level = 6);

}  // namespace palpate::link
