#include "volume_io/formats/formats.h"
#include "volume_io/formats/headers.h"
#include "volume_io/voxel_stream.h"

namespace palpate::volume_io {

Result<VolumeFile> inspect_metaimage(const std::filesystem::path& file, OtherFiles& others,
                                     const PlacementOptions&) {
  const std::string source = file.string();
  const auto front = read_front(file, Encoding::kRaw, kMaxHeaderBytes);
  if (!front) return front.error();
  const auto header = parse_metaimage_header(*front, source);
  if (!header) return header.error();
  const auto dims = volume_dims(header->axes, source);
  if (!dims) return dims.error();

  VolumeFile volume;
  volume.voxels = header->voxels;
  volume.voxels.file = file;
  if (!header->data_file.empty()) {
    const auto data = others.find({OtherFile::Which::kNamed, header->data_file});
    if (!data) return data.error();
    volume.voxels.file = *data;
  }
  const auto geometry = grid_of(header->geometry, *dims, source);
  if (!geometry) return geometry.error();
  volume.header.geometry = *geometry;
  volume.header.has_geometry = header->has_geometry;
  return volume;
}

}  // namespace palpate::volume_io
