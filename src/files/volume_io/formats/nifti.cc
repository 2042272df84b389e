#include <algorithm>
#include <cstdio>

#include "volume_io/formats/formats.h"
#include "volume_io/formats/headers.h"
#include "volume_io/voxel_stream.h"

namespace palpate::volume_io {
namespace {

// by the magic number of gzip (RFC 1952), whatever the extension
Result<Encoding> encoding_of(const std::filesystem::path& file) {
  const auto front = read_front(file, Encoding::kRaw, 2);
  if (!front) return front.error();
  return *front == "\x1f\x8b" ? Encoding::kDeflate : Encoding::kRaw;
}

// grid of a transform from voxel index to RAS mm; its directions need not be orthogonal
GridGeometry from_affine(const Eigen::Matrix<double, 3, 4>& affine, const std::array<int, 3>& dims) {
  // RAS to LPS
  const Eigen::Matrix<double, 3, 4> lps = Eigen::Vector3d(-1, -1, 1).asDiagonal() * affine;
  GridGeometry geometry;
  geometry.dims = dims;
  geometry.origin = Point<Patient>(Eigen::Vector3d(lps.col(3)));
  for (int a = 0; a < 3; ++a) {
    geometry.spacing_mm[a] = lps.col(a).norm();
    geometry.direction.col(a) = lps.col(a) / geometry.spacing_mm[a];
  }
  return geometry;
}

// Note for the user if the two transforms of a file differ in handedness, or by more than the smallest voxel
// spacing at any corner of the volume; otherwise empty.
std::string doubt_of_forms(const GridGeometry& sform, const GridGeometry& qform) {
  const bool mirrored = sform.right_handed() != qform.right_handed();
  double max_mm = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const auto at = [&](int axis) {
      return corner >> axis & 1 ? sform.dims[static_cast<std::size_t>(axis)] - 1 : 0;
    };
    const Point<Voxel> voxel(at(0), at(1), at(2));
    max_mm = std::max(max_mm, (sform.X_PatientVoxel() * voxel - qform.X_PatientVoxel() * voxel).norm());
  }
  if (!mirrored && max_mm <= sform.min_spacing_mm()) return "";
  const auto reading = [](const GridGeometry& grid) {
    char text[160];
    const Eigen::Vector3d centre = grid.centre().eigen();
    std::snprintf(text, sizeof text, "its axes are %s and its centre is at (%.1f, %.1f, %.1f) mm",
                  axis_codes(grid.direction).c_str(), centre.x(), centre.y(), centre.z());
    return std::string(text);
  };
  char off[60];
  std::snprintf(off, sizeof off, "by up to %.1f mm", max_mm);
  return std::string("has a qform and an sform that differ ") + (mirrored ? "by a mirror" : off) +
         ", so its sides are uncertain: by the sform, which is used, " + reading(sform) + "; by the qform " +
         reading(qform) + " (LPS); choose one with --form q or s (in a scene file: nifti_form)";
}

// Reads label names from a CaretExtension, if the file has one. A malformed table adds a note; only a file
// that cannot be read is an error.
Result<void> read_label_names_of(const std::filesystem::path& file, Encoding encoding,
                                 const NiftiHeader& header, VolumeFile& volume) {
  constexpr std::uint64_t kMaxBytes = std::uint64_t{4} << 20;
  // extensions lie between header and voxels; in a separate header they extend to the end of the file
  const std::uint64_t end = header.has_detached_data ? kMaxBytes : std::min(header.voxels.skip, kMaxBytes);
  // four bytes after the header state whether extensions follow
  if (end <= header.header_bytes + 4) return {};
  const auto bytes = read_front(file, encoding, static_cast<std::size_t>(end));
  if (!bytes) return bytes.error();
  const auto xml = find_caret_extension(*bytes, header.header_bytes, header.swapped);
  auto fields = parse_caret_labels(xml, file.string());
  if (fields)
    volume.segment_fields = *std::move(fields);
  else
    volume.notes.push_back(fields.error().what + "; " + fields.error().remedy);
  return {};
}

}  // namespace

Result<VolumeFile> inspect_nifti(const std::filesystem::path& named, OtherFiles& others,
                                 const PlacementOptions& placement_options) {
  std::filesystem::path file = named;
  if (has_extension(named, ".img") || has_extension(named, ".img.gz")) {
    const auto header_file = others.find({OtherFile::Which::kHeader, ""});
    if (!header_file) return header_file.error();
    file = *header_file;
  }
  const std::string source = file.string();
  const auto encoding = encoding_of(file);
  if (!encoding) return encoding.error();
  const auto front = read_front(file, *encoding, kMaxNiftiHeaderBytes);
  if (!front) return front.error();
  const auto header = parse_nifti_header(*front, source, placement_options.nifti_form);
  if (!header) return header.error();
  const auto dims = volume_dims(header->axes, source);
  if (!dims) return dims.error();

  VolumeFile volume;
  if (auto read = read_label_names_of(file, *encoding, *header, volume); !read) return read.error();
  volume.voxels = header->voxels;
  volume.voxels.file = file;
  volume.voxels.encoding = *encoding;
  if (header->has_detached_data) {
    const auto data = others.find({OtherFile::Which::kVoxels, ""});
    if (!data) return data.error();
    const auto data_encoding = encoding_of(*data);
    if (!data_encoding) return data_encoding.error();
    volume.voxels.file = *data;
    volume.voxels.encoding = *data_encoding;
  }

  // If there is an sform, palpate uses it for the geometry, as nibabel, FSL and FreeSurfer do, unless the
  // qform was requested. ITK would take voxel sizes from pixdim even if the sform contradicts them, and
  // prefer the qform in that case.
  const auto geometry = header->affine ? checked(from_affine(*header->affine, *dims), source)
                                       : grid_of(header->geometry, *dims, source);
  if (!geometry) return geometry.error();
  volume.header.geometry = *geometry;
  volume.header.has_geometry = header->has_geometry;
  volume.header.meaning = header->meaning;
  // an invalid qform is ignored here, because the sform takes precedence
  if (header->other_affine)
    if (const auto other = checked(from_affine(*header->other_affine, *dims), source); other) {
      volume.header.placement_doubt = doubt_of_forms(*geometry, *other);
      if (!volume.header.placement_doubt.empty()) volume.notes.push_back(volume.header.placement_doubt);
    }
  return volume;
}

}  // namespace palpate::volume_io
