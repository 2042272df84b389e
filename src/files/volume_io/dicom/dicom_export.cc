#include "palpate/volume_io/dicom_export.h"

#include <algorithm>
#include <cmath>
#include <new>

#include "palpate/base/file.h"
#include "volume_io/dicom/dicom.h"
#include "volume_io/dicom/dicom_library.h"
#include "volume_io/dicom/dicom_segment_names.h"
#include "volume_io/dicom/dicom_segments.h"
#include "volume_io/labels/label_text.h"
#include "volume_io/voxel_source.h"

namespace palpate {

using namespace volume_io;

namespace {

SegmentToWrite segment_to_write(const Segment& segment) {
  SegmentToWrite out;
  // maximum length of a SegmentLabel
  std::size_t retained = 64;
  // do not cut a UTF-8 character
  while (retained < segment.name.size() && (segment.name[retained] & 0xC0) == 0x80) --retained;
  out.name = segment.name.empty() ? "label " + std::to_string(segment.id) : segment.name.substr(0, retained);
  std::ranges::replace(out.name, '\\', '/');
  out.colour = {segment.colour.r, segment.colour.g, segment.colour.b};
  const DicomSegment known = segment_from_name(segment.name);
  out.code = known.code;
  out.meaning = known.meaning;
  out.side = known.side;
  return out;
}

Result<SegmentationToWrite> segmentation_of(const LabelMap& labels, const std::filesystem::path& file) {
  const GridGeometry& grid = labels.geometry();
  const Eigen::Vector3d x = grid.direction.col(0), y = grid.direction.col(1), z = grid.direction.col(2);
  constexpr double kSquare = 1e-4;
  if (std::abs(x.dot(y)) > kSquare || std::abs(y.dot(z)) > kSquare || std::abs(z.dot(x)) > kSquare)
    return bad_input(file.string(),
                     "its axes would not be orthogonal, which a DICOM segmentation cannot represent",
                     "write it as .seg.nrrd");
  constexpr int kMaxAlong = 65535;
  if (grid.dims[0] > kMaxAlong || grid.dims[1] > kMaxAlong)
    return bad_input(file.string(), "would have more rows or columns than DICOM allows",
                     "write it as .seg.nrrd");
  SegmentationToWrite seg;
  seg.columns = grid.dims[0];
  seg.rows = grid.dims[1];
  seg.along_row = x;
  seg.along_column = y;
  seg.column_spacing_mm = grid.spacing_mm[0];
  seg.row_spacing_mm = grid.spacing_mm[1];
  seg.slice_spacing_mm = grid.spacing_mm[2];

  const std::size_t slice_voxels =
      static_cast<std::size_t>(grid.dims[0]) * static_cast<std::size_t>(grid.dims[1]);
  const auto X = grid.X_PatientVoxel();
  std::uint64_t bit = 0;
  for (const Segment& segment : labels.segments) {
    const auto& voxels = labels.layers[static_cast<std::size_t>(segment.layer)].voxels();
    if (std::ranges::find(voxels, segment.value) == voxels.end()) continue;
    const bool first_segment = seg.segments.empty();
    seg.segments.push_back(segment_to_write(segment));
    for (int k = 0; k < grid.dims[2]; ++k) {
      const auto slice = std::span(voxels).subspan(static_cast<std::size_t>(k) * slice_voxels, slice_voxels);
      const bool ends = first_segment && (k == 0 || k == grid.dims[2] - 1);
      if (!ends && std::ranges::find(slice, segment.value) == slice.end()) continue;
      seg.frames.push_back({static_cast<int>(seg.segments.size()), (X * Point<Voxel>(0, 0, k)).eigen()});
      seg.bits.resize(static_cast<std::size_t>((bit + slice_voxels + 7) / 8));
      for (const LabelId voxel : slice) {
        if (voxel == segment.value)
          seg.bits[static_cast<std::size_t>(bit / 8)] |= static_cast<std::uint8_t>(1 << bit % 8);
        ++bit;
      }
    }
  }
  if (seg.segments.empty())
    return bad_input(file.string(), "would hold no segment: no voxel has a label",
                     "export labels that have voxels");
  return seg;
}

// writes a temporary file and renames it
template <class Write>
Result<void> write_object(const std::filesystem::path& file, const std::optional<DicomAttachment>& attached,
                          const Progress& progress, const Write& write) {
  const auto library = ready_dicom_library();
  if (!library) return library.error();
  std::optional<DicomIdentity> identity;
  if (attached) {
    auto found = identity_of_study(*attached, progress);
    if (!found) return found.error();
    identity = *std::move(found);
  }
  auto pending = PendingFile::create(file);
  if (!pending) return pending.error();
  if (auto written = write(**library, pending->path(), identity); !written) {
    Error error = written.error();
    error.where = file.string();
    return error;
  }
  return pending->commit();
}

}  // namespace

Result<void> write_dicom_segmentation(const std::filesystem::path& file, const LabelMap& labels,
                                      const std::optional<DicomAttachment>& attached,
                                      const Progress& progress) try {
  const auto seg = segmentation_of(labels, file);
  if (!seg) return seg.error();
  return write_object(file, attached, progress,
                      [&](DicomLibrary& library, const std::filesystem::path& path, const auto& identity) {
                        return library.write_segmentation(path, *seg, identity);
                      });
} catch (const std::bad_alloc&) {
  return bad_input(file.string(), "does not fit into the memory", "close other programs first");
}

Result<void> write_secondary_capture(const std::filesystem::path& file, int width, int height,
                                     std::span<const std::uint8_t> rgb, const std::string& description,
                                     const std::optional<DicomAttachment>& attached,
                                     const Progress& progress) {
  PALPATE_CHECK(width > 0 && height > 0 && width <= 65535 && height <= 65535);
  PALPATE_CHECK(rgb.size() ==
                std::size_t{3} * static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  return write_object(file, attached, progress,
                      [&](DicomLibrary& library, const std::filesystem::path& path, const auto& identity) {
                        return library.write_picture(path, {height, width, rgb, description}, identity);
                      });
}

}  // namespace palpate
