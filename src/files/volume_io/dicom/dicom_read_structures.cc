#include <algorithm>

#include "palpate/base/file.h"
#include "volume_io/dicom/dicom_read_labels.h"
#include "volume_io/dicom/dicom_segment_names.h"
#include "volume_io/labels/layered_labels.h"
#include "volume_io/structure_files.h"
#include "volume_io/volume_message.h"
#include "volume_io/voxel_stream.h"

namespace palpate::volume_io {
namespace {

namespace fs = std::filesystem;

// contours rasterised on the grid of a scan
struct Structures {
  // structures that had closed contours; `contours` is empty, since `planes` replaces it
  std::vector<DicomStructure> declared;
  std::vector<StructurePlanes> planes;
  std::vector<int> layers;
  VolumeFile file;
};

std::string colour_of_structure(const DicomStructure& structure) {
  std::string text;
  if (structure.colour)
    for (const std::uint8_t part : *structure.colour)
      text += (text.empty() ? "" : " ") + std::to_string(static_cast<double>(part) / 255);
  return text;
}

// notes for the user: missing contours, filled gaps, clipped and empty structures
void note_structures(const Structures& structures, const std::vector<std::string>& without_contours,
                     std::size_t left_out, const std::vector<std::uint64_t>& voxels, VolumeFile& file) {
  std::vector<std::string> cut, empty;
  std::size_t bridged = 0;
  std::vector<std::string> with_gaps;
  for (std::size_t n = 0; n < structures.planes.size(); ++n) {
    const std::string name = name_of_segment(structures.declared[n].segment);
    if (structures.planes[n].bridged() > 0) with_gaps.push_back(name);
    bridged += structures.planes[n].bridged();
    if (voxels[n] == 0)
      empty.push_back(name);
    else if (structures.planes[n].is_cut())
      cut.push_back(name);
  }
  const auto warn_about = [&](const std::string& what, const std::vector<std::string>& names) {
    if (!names.empty()) file.notes.push_back(what + ": " + names_in_words(names));
  };
  warn_about("has structures without a closed contour, which were left out", without_contours);
  if (left_out > 0)
    file.notes.push_back(counted(left_out, "contour is open, a point or less than a triangle, and was",
                                 "contours are open, points or less than a triangle, and were") +
                         " left out");
  warn_about("lacks contours in " + counted(bridged, "plane", "planes") +
                 " between others, where the contours of the nearest plane are used",
             with_gaps);
  warn_about("has structures that extend beyond the scan and are cut off there", cut);
  warn_about("has structures that contain no voxel centre or lie outside the scan", empty);
}

// @param should_continue  called regularly; false: the parent has gone
template <class ShouldContinue>
Result<Structures> inspect_structures(DicomLibrary& library, const fs::path& named, const GridGeometry& grid,
                                      const ShouldContinue& should_continue) {
  library.begin_reading();
  Structures structures;
  std::vector<std::string> without_contours;
  std::size_t left_out = 0;
  const auto opened = InputFile::open(named);
  if (!opened) return opened.error();
  auto declared = library.read_structures(opened->name_for_libraries());
  if (!declared) return declared.error();
  if (declared->size() >= kLabelValues)
    return bad_input("", "has more structures than label numbers", "export fewer of them");
  for (DicomStructure& structure : *declared) {
    left_out += structure.left_out;
    if (structure.contours.empty()) {
      without_contours.push_back(name_of_segment(structure.segment));
      continue;
    }
    if (!should_continue()) break;
    auto planes = StructurePlanes::make(structure, grid);
    if (!planes) return planes.error();
    structures.planes.push_back(*std::move(planes));
    structure.contours.clear();
    structures.declared.push_back(std::move(structure));
  }

  std::vector<std::uint64_t> voxels(structures.planes.size());
  const auto read_slice = [&](std::size_t k, const auto& take) -> Result<void> {
    for (std::size_t n = 0; n < structures.planes.size(); ++n)
      structures.planes[n].read_slice(static_cast<int>(k), [&](std::size_t v) {
        ++voxels[n];
        take(v, static_cast<int>(n));
      });
    return {};
  };
  const auto overlaps = find_overlapping_pairs(grid, read_slice, should_continue);
  if (!overlaps) return overlaps.error();
  structures.file = labels_in_slices(grid, named);
  structures.layers = assign_layers(structures.planes.size(), *overlaps, structures.file);
  note_structures(structures, without_contours, left_out, voxels, structures.file);
  for (std::size_t n = 0; n < structures.declared.size(); ++n)
    put_segment(structures.file, n, name_of_segment(structures.declared[n].segment),
                structures.declared[n].segment.number, structures.layers[n],
                colour_of_structure(structures.declared[n]));
  return structures;
}

Result<void> send_structures(const Structures& structures, VoxelSink& sink) {
  const auto read_slice = [&](int layer, std::size_t k, const auto& take) -> Result<void> {
    for (std::size_t n = 0; n < structures.planes.size(); ++n)
      if (structures.layers[n] == layer)
        structures.planes[n].read_slice(
            static_cast<int>(k), [&](std::size_t v) { take(v, structures.declared[n].segment.number); });
    return {};
  };
  return send_layers(structures.file.header, read_slice, sink);
}

bool serve_structures(DicomLibrary& library, reader::ParentEnd& parent, const fs::path& named,
                      const GridGeometry& grid) {
  const auto structures = inspect_structures(library, named, grid, sign_of_life(parent));
  return serve_labels(parent, named, structures,
                      [&](VoxelSink& sink) { return send_structures(*structures, sink); });
}

}  // namespace

Result<DicomReader> open_dicom_structures(const fs::path& file, const GridGeometry& grid,
                                          const Progress& progress) {
  auto reader =
      open_dicom_labels(file, {file}, progress,
                        [&](DicomLibrary& library, reader::ParentEnd& parent, const std::vector<fs::path>&) {
                          return serve_structures(library, parent, file, grid);
                        });
  const Files named{&file, 1};
  if (reader && !reader->volume.header.geometry.same_grid(grid)) return impossible_volume(named);
  return reader;
}

}  // namespace palpate::volume_io
