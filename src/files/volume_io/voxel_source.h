#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "palpate/volume_io/volume_io.h"
#include "volume_io/component.h"

/// Result of parsing a file before its voxels are read: the header's contents, and the location and encoding
/// of the voxels. All formats share the code that reads them (voxel_stream.h).
namespace palpate::volume_io {

enum class Encoding {
  kRaw,
  kDeflate,  ///< gzip or zlib, distinguished by their first bytes.
  kBzip2,
  kText,  ///< Numbers separated by white space or commas.
  kHex,
  kSlices,  ///< Generated slice by slice, see dicom.h and meshes.h.
};

struct VoxelSource {
  std::filesystem::path file;
  Encoding encoding = Encoding::kRaw;
  Component component = Component::kInt16;
  bool big_endian = false;   ///< Byte order, for binary encodings.
  std::uint64_t offset = 0;  ///< Position of the encoded voxels in the file; bytes.
  std::uint64_t skip = 0;    ///< Decoded bytes before the first voxel.
  /// If set, the voxels are the last decoded bytes except for this number of bytes after them; `skip` is
  /// unused.
  std::optional<std::uint64_t> trailing_bytes;
  bool may_have_more = false;       ///< Surplus bytes after the voxels are accepted, because in this format
                                    ///< they do not indicate a misread header.
  double slope = 1, intercept = 0;  ///< value = slope * stored + intercept
};

/// A file that has been parsed but whose voxels are not yet read.
struct VolumeFile {
  /// Number of values in all layers.
  std::uint64_t value_count() const {
    return header.geometry.voxel_count() * static_cast<std::uint64_t>(header.layers);
  }

  VolumeHeader header;
  VoxelSource voxels;
  bool layers_first = true;  ///< If layers > 1: the layer is the fastest axis, otherwise the slowest.
  std::vector<std::pair<std::string, std::string>> segment_fields;  ///< SegmentN_* fields of an NRRD.
  bool padded = false;             ///< NaN values mark voxels outside the scanned region.
  std::vector<std::string> notes;  ///< Notes for the user, one sentence each.
};

/// Dimensions of a volume from a file's axes: one or two missing axes count as 1, and axes beyond the third
/// must be 1. Errors: no or too many axes; an axis without voxels; too many voxels.
Result<std::array<int, 3>> volume_dims(const std::vector<std::int64_t>& axes, const std::string& source);

inline Error bad_input(const std::string& source, std::string what, std::string remedy = "") {
  return {ErrorKind::kBadInput, std::move(what), source, std::move(remedy)};
}

/// Validates a geometry: finite, positive spacing, linearly independent directions.
Result<GridGeometry> checked(const GridGeometry& geometry, const std::string& source);

/// Path of the data file that a header names, in the header's folder. Headers are untrusted: names and links
/// that leave the folder are an error unless they are allowed (palpate/base/reading.h), and so is anything
/// but a regular file.
Result<std::filesystem::path> data_file_beside(const std::filesystem::path& header, const std::string& name);

}  // namespace palpate::volume_io
