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

/// What a reader of one format finds out before a voxel is read: what the header promises, and where
/// and how the voxels stand. Reading them is then one piece of code for every format (voxel_stream.h).
namespace palpate::volume_io {

enum class Encoding {
  kRaw,
  kDeflate,  ///< gzip or zlib, told apart by their first bytes
  kBzip2,
  kText,  ///< numbers between white space or commas
  kHex,
  kSlices,  ///< slice by slice, as dicom.h and meshes.h make them
};

struct VoxelSource {
  std::filesystem::path file;
  Encoding encoding = Encoding::kRaw;
  Component component = Component::kInt16;
  bool big_endian = false;   ///< of the binary encodings
  std::uint64_t offset = 0;  ///< bytes of the file before the encoded voxels
  std::uint64_t skip = 0;    ///< decoded bytes before the first voxel
  /// When set the voxels are the last decoded bytes except for this many after them; `skip` is unused.
  std::optional<std::uint64_t> bytes_after;
  bool may_have_more = false;       ///< more bytes after the voxels are no sign of a misread header
  double slope = 1, intercept = 0;  ///< value = slope * stored + intercept
};

/// One file on disk, understood but not yet read.
struct VolumeFile {
  /// Over all layers.
  std::uint64_t value_count() const {
    return header.geometry.voxel_count() * static_cast<std::uint64_t>(header.layers);
  }

  VolumeHeader header;
  VoxelSource voxels;
  bool layers_first = true;  ///< layers > 1: the layer is the fastest axis, else the slowest
  std::vector<std::pair<std::string, std::string>> segment_fields;  ///< SegmentN_* of an NRRD
  bool padded = false;             ///< what is not a number among the values lies outside what was scanned
  std::vector<std::string> notes;  ///< what a person should know, a sentence each
};

/// Axes of a file as dims of a volume: one or two missing axes are one voxel, axes beyond the third
/// must be. Errors: no or too many axes, an axis without voxels, more voxels than can be counted.
Result<std::array<int, 3>> volume_dims(const std::vector<std::int64_t>& axes, const std::string& source);

inline Error bad_input(const std::string& source, std::string what, std::string remedy = "") {
  return {ErrorKind::kBadInput, std::move(what), source, std::move(remedy)};
}

/// The geometry if it can be one: finite, positive spacing, directions that span space.
Result<GridGeometry> checked(const GridGeometry& geometry, const std::string& source);

/// The file beside its header that the header names. A header is untrusted: names that lead out of its
/// folder, and links there that do, are an error unless that is allowed (palpate/base/reading.h), and so is
/// what is not a plain file.
Result<std::filesystem::path> data_file_beside(const std::filesystem::path& header, const std::string& name);

}  // namespace palpate::volume_io
