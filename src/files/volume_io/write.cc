#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <new>

#include "palpate/base/file.h"
#include "volume_io/formats/formats.h"
#include "volume_io/volume_reader.h"

namespace palpate {

using namespace volume_io;

namespace {

Error cannot_write(const std::filesystem::path& file, std::string what, std::string remedy = "") {
  return {ErrorKind::kOutput, std::move(what), file.string(), std::move(remedy)};
}

/// Reads the file back and compares every byte, because the libraries do not always detect a full disk.
bool reads_back(const std::filesystem::path& file, const GridGeometry& geometry, const ItkImage& image) {
  const Progress silent;
  auto reader = VolumeReader::open(file, silent);
  if (!reader) return false;
  const VolumeHeader& written = reader->file().header;
  if (!written.geometry.same_grid(geometry) || written.component_type != name_of(image.component) ||
      written.layers != image.components)
    return false;
  const auto* expected = static_cast<const std::byte*>(image.voxels);
  const std::size_t size = bytes_of(image.component);
  bool equal = true;
  const auto read = reader->stream([&](std::uint64_t first, std::span<const std::byte> values) {
    equal = equal && std::memcmp(values.data(), expected + first * size, values.size()) == 0;
    return Result<void>();
  });
  return read.ok() && equal;
}

bool disk_is_full(const std::filesystem::path& file) {
  std::error_code failed;
  const auto space = std::filesystem::space(file.parent_path().empty() ? "." : file.parent_path(), failed);
  return !failed && space.available < (1 << 16);
}

ItkGrid itk_grid(const GridGeometry& geometry) {
  ItkGrid grid;
  grid.dims = geometry.dims;
  for (int a = 0; a < 3; ++a) {
    const auto n = static_cast<std::size_t>(a);
    grid.spacing_mm[n] = geometry.spacing_mm[a];
    grid.origin_mm[n] = geometry.origin[a];
    for (int r = 0; r < 3; ++r) grid.columns[n][static_cast<std::size_t>(r)] = geometry.direction(r, a);
  }
  return grid;
}

Result<void> write_image(const std::filesystem::path& file, const GridGeometry& geometry,
                         const ItkImage& image) try {
  const auto found = format_of(file);
  if (!found) return cannot_write(file, found.error().what, found.error().remedy);
  const Format& format = **found;
  if (std::none_of(format.write_extensions.begin(), format.write_extensions.end(),
                   [&](std::string_view ending) { return has_extension(file, ending); }))
    return cannot_write(file, "would be two files, but volumes are written as one",
                        "use .nrrd, .nii.gz or .mha");
  if (geometry.voxel_count() == 0) return cannot_write(file, "would hold no voxels");
  constexpr int kMaxNifti = 32767;
  if (format.writer == ItkFormat::kNifti &&
      *std::max_element(geometry.dims.begin(), geometry.dims.end()) > kMaxNifti)
    return cannot_write(file, "cannot be NIfTI, which has at most 32767 voxels along an axis", "use .nrrd");

  auto pending = PendingFile::create(file);
  if (!pending) return pending.error();
  const auto written = itk_write(format.writer, pending->path(), image);
  if (!written || !reads_back(pending->path(), geometry, image)) {
    if (disk_is_full(file)) return output_error(file, ENOSPC);
    if (!written) return cannot_write(file, written.error().what);
    return cannot_write(file, std::string("could not be written exactly as ") + format.name,
                        "check the free space, or use .nrrd, which supports every geometry");
  }
  return pending->commit();
} catch (const std::exception& exception) {
  return cannot_write(file, std::string("cannot be written: ") + exception.what());
}

template <class T>
Result<void> write_scalar(const std::filesystem::path& file, const Volume<T>& volume, Component component) {
  return write_image(file, volume.geometry(),
                     {itk_grid(volume.geometry()), component, 1, volume.voxels().data(), {}});
}

// Slicer's fields, with segments numbered as Slicer does
std::vector<std::pair<std::string, std::string>> segment_fields(const LabelMap& labels) {
  std::vector<std::pair<std::string, std::string>> fields;
  const auto& dims = labels.geometry().dims;
  const std::string extent = "0 " + std::to_string(dims[0] - 1) + " 0 " + std::to_string(dims[1] - 1) +
                             " 0 " + std::to_string(dims[2] - 1);
  for (std::size_t n = 0; n < labels.segments.size(); ++n) {
    const Segment& s = labels.segments[n];
    const std::string prefix = "Segment" + std::to_string(n) + "_";
    char colour[64];
    std::snprintf(colour, sizeof colour, "%.6f %.6f %.6f", s.colour.r / 255.0, s.colour.g / 255.0,
                  s.colour.b / 255.0);
    fields.emplace_back(prefix + "ID", "Segment_" + std::to_string(s.id));
    if (!s.name.empty()) fields.emplace_back(prefix + "Name", s.name);
    fields.emplace_back(prefix + "Color", colour);
    fields.emplace_back(prefix + "Extent", extent);
    fields.emplace_back(prefix + "Layer", std::to_string(s.layer));
    fields.emplace_back(prefix + "LabelValue", std::to_string(s.value));
  }
  fields.emplace_back("Segmentation_ContainedRepresentationNames", "Binary labelmap|");
  fields.emplace_back("Segmentation_MasterRepresentation", "Binary labelmap");
  fields.emplace_back("Segmentation_ReferenceImageExtentOffset", "0 0 0");
  return fields;
}

// values of all layers as T, interleaved with the layer as fastest axis
template <class T>
std::vector<T> interleaved(const LabelMap& labels) {
  const std::size_t layers = labels.layers.size();
  std::vector<T> values(labels.geometry().voxel_count() * layers);
  for (std::size_t layer = 0; layer < layers; ++layer) {
    const auto& voxels = labels.layers[layer].voxels();
    for (std::size_t n = 0; n < voxels.size(); ++n) values[n * layers + layer] = static_cast<T>(voxels[n]);
  }
  return values;
}

}  // namespace

Result<void> write_volume(const std::filesystem::path& file, const Volume<float>& volume) {
  return write_scalar(file, volume, Component::kFloat32);
}
Result<void> write_volume(const std::filesystem::path& file, const Volume<std::uint8_t>& volume) {
  return write_scalar(file, volume, Component::kUint8);
}
Result<void> write_volume(const std::filesystem::path& file, const Volume<std::uint16_t>& volume) {
  return write_scalar(file, volume, Component::kUint16);
}
Result<void> write_volume(const std::filesystem::path& file, const Volume<std::int16_t>& volume) {
  return write_scalar(file, volume, Component::kInt16);
}

Result<void> write_labels(const std::filesystem::path& file, const LabelMap& labels) try {
  const bool slicer = has_extension(file, ".seg.nrrd");
  if (labels.layers.empty()) return cannot_write(file, "would hold no labels");
  if (labels.layers.size() > 1 && !slicer)
    return cannot_write(file, "cannot hold overlapping segments", "give it a name that ends in .seg.nrrd");
  LabelId highest = 0;
  for (const auto& layer : labels.layers)
    for (const LabelId value : layer.voxels()) highest = std::max(highest, value);

  ItkImage image{
      itk_grid(labels.geometry()), Component::kUint8, static_cast<int>(labels.layers.size()), nullptr, {}};
  if (slicer) image.text_fields = segment_fields(labels);
  if (highest <= 255) {
    const auto values = interleaved<std::uint8_t>(labels);
    image.voxels = values.data();
    return write_image(file, labels.geometry(), image);
  }
  const auto values = interleaved<std::uint16_t>(labels);
  image.component = Component::kUint16;
  image.voxels = values.data();
  return write_image(file, labels.geometry(), image);
} catch (const std::bad_alloc&) {
  return cannot_write(file, "does not fit into the memory");
}

}  // namespace palpate
