#include "volume_io/formats/formats.h"
#include "volume_io/formats/headers.h"
#include "volume_io/voxel_stream.h"

namespace palpate::volume_io {
namespace {

// offset after `lines` line ends
Result<std::uint64_t> skip_lines(const std::filesystem::path& file, std::uint64_t offset, int lines) {
  if (lines == 0) return offset;
  const auto bytes = read_front(file, Encoding::kRaw, static_cast<std::size_t>(offset) + kMaxHeaderBytes);
  if (!bytes) return bytes.error();
  for (; lines > 0; --lines) {
    const auto end = bytes->find('\n', static_cast<std::size_t>(offset));
    if (end == std::string::npos)
      return bad_input(file.string(), "has fewer lines than its line skip", "is the file complete?");
    offset = end + 1;
  }
  return offset;
}

/// Rejects a negative byte skip for which the file is too short; ITK would only report a failed seek.
Result<void> check_negative_byte_skip(const VoxelSource& voxels, const std::array<int, 3>& dims, int layers,
                                      const std::string& source) {
  if (voxels.encoding != Encoding::kRaw || !voxels.trailing_bytes) return {};
  GridGeometry grid;
  grid.dims = dims;
  const std::uint64_t needed =
      grid.voxel_count() * static_cast<std::uint64_t>(layers) * bytes_of(voxels.component);
  std::error_code failed;
  const std::uint64_t size = std::filesystem::file_size(voxels.file, failed);
  if (!failed && size >= voxels.offset + needed + *voxels.trailing_bytes) return {};
  return bad_input(
      source,
      "its byte skip of -" + std::to_string(*voxels.trailing_bytes + 1) + " requires " +
          std::to_string(voxels.offset + needed + *voxels.trailing_bytes) +
          " bytes of voxel data, but there are " + std::to_string(failed ? 0 : size),
      "the data are cut short, or the byte skip is wrong: -1 means that the voxels end the file");
}

}  // namespace

Result<VolumeFile> inspect_nrrd(const std::filesystem::path& file, OtherFiles& others,
                                const PlacementOptions&) {
  const std::string source = file.string();
  const auto front = read_front(file, Encoding::kRaw, kMaxHeaderBytes);
  if (!front) return front.error();
  auto header = parse_nrrd_header(*front, source);
  if (!header) return header.error();
  const auto dims = volume_dims(header->axes, source);
  if (!dims) return dims.error();

  // location of the voxels
  VolumeFile volume;
  volume.voxels = header->voxels;
  volume.voxels.file = file;
  if (!header->data_file.empty()) {
    const auto data = others.find({OtherFile::Which::kNamed, header->data_file});
    if (!data) return data.error();
    volume.voxels.file = *data;
    volume.voxels.offset = 0;
  }
  const auto offset = skip_lines(volume.voxels.file, volume.voxels.offset, header->line_skip);
  if (!offset) return offset.error();
  volume.voxels.offset = *offset;

  if (auto fits = check_negative_byte_skip(volume.voxels, *dims, header->layers, source); !fits)
    return fits.error();

  const auto geometry = grid_of(header->geometry, *dims, source);
  if (!geometry) return geometry.error();
  volume.header.geometry = *geometry;
  volume.header.layers = header->layers;
  volume.header.has_geometry = header->has_geometry;
  volume.layers_first = header->layers_first;
  volume.segment_fields = std::move(header->segment_fields);
  return volume;
}

}  // namespace palpate::volume_io
