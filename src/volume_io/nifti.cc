#include "volume_io/formats.h"
#include "volume_io/headers.h"
#include "volume_io/voxel_stream.h"

namespace palpate::volume_io {
namespace {

Result<Encoding> encoding_of(const std::filesystem::path& file) {
  const auto front = read_front(file, Encoding::kRaw, 2);
  if (!front) return front.error();
  return *front == "\x1f\x8b" ? Encoding::kDeflate : Encoding::kRaw;
}

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

}  // namespace

Result<VolumeFile> inspect_nifti(const std::filesystem::path& named, OtherFiles& others) {
  std::filesystem::path file = named;
  if (has_ending(named, ".img") || has_ending(named, ".img.gz")) {
    const auto header_file = others.find({OtherFile::Which::kHeader, ""});
    if (!header_file) return header_file.error();
    file = *header_file;
  }
  const std::string source = file.string();
  const auto encoding = encoding_of(file);
  if (!encoding) return encoding.error();
  const auto front = read_front(file, *encoding, kMostNiftiHeaderBytes);
  if (!front) return front.error();
  const auto header = parse_nifti_header(*front, source);
  if (!header) return header.error();
  const auto dims = volume_dims(header->axes, source);
  if (!dims) return dims.error();

  VolumeFile volume;
  volume.voxels = header->voxels;
  volume.voxels.file = file;
  volume.voxels.encoding = *encoding;
  if (header->separate) {
    const auto data = others.find({OtherFile::Which::kVoxels, ""});
    if (!data) return data.error();
    const auto data_encoding = encoding_of(*data);
    if (!data_encoding) return data_encoding.error();
    volume.voxels.file = *data;
    volume.voxels.encoding = *data_encoding;
  }

  // ITK takes voxel sizes from pixdim even where the sform says otherwise, and then prefers the qform;
  // nibabel, FSL and FreeSurfer go by the sform when there is one, and so do we
  const auto geometry = header->affine ? checked(from_affine(*header->affine, *dims), source)
                                       : itk_geometry(ItkFormat::kNifti, file, *dims);
  if (!geometry) return geometry.error();
  volume.header.geometry = *geometry;
  volume.header.has_geometry = header->has_geometry;
  volume.header.meaning = header->meaning;
  return volume;
}

}  // namespace palpate::volume_io
