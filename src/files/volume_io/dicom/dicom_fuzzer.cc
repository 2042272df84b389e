#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <string>
#include <vector>

#include "volume_io/dicom/dicom_library.h"
#include "volume_io/dicom/dicom_segment_grid.h"
#include "volume_io/dicom/dicom_segment_names.h"
#include "volume_io/formats/file_kind.h"

namespace {

using namespace palpate;
using namespace palpate::volume_io;

void must(bool condition) {
  if (!condition) std::abort();
}

DicomLibrary& library() {
  static DicomLibrary& files = [&]() -> DicomLibrary& {
    must(palpate_dicom_library()->load_dictionary().ok());
    palpate_dicom_library()->begin_reading();
    return *palpate_dicom_library();
  }();
  return files;
}

// bytes under a path that DCMTK can open repeatedly
class NamedBytes {
 public:
  NamedBytes(const std::uint8_t* data, std::size_t size) : descriptor_(::memfd_create("dicom", MFD_CLOEXEC)) {
    must(descriptor_ >= 0 && ::write(descriptor_, data, size) == static_cast<ssize_t>(size));
  }
  ~NamedBytes() { ::close(descriptor_); }
  NamedBytes(const NamedBytes&) = delete;
  NamedBytes& operator=(const NamedBytes&) = delete;
  std::string name() const { return "/proc/self/fd/" + std::to_string(descriptor_); }

 private:
  int descriptor_;
};

// the same bytes as a structure set on some grid, and their references
void inspect_structures(const std::string& name) {
  if (const auto reference = library().read_reference(name); !reference)
    must(!reference.error().what.empty());
  const auto structures = library().read_structures(name);
  if (!structures) return must(!structures.error().what.empty());
  GridGeometry grid;
  grid.dims = {16, 12, 10};
  grid.spacing_mm = {0.5, 0.7, 1.25};
  grid.direction = Eigen::AngleAxisd(0.3, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  grid.origin = Point<Patient>(-10, 20, -30);
  for (const DicomStructure& structure : *structures) {
    if (structure.contours.empty()) continue;
    const auto planes = StructurePlanes::make(structure, grid);
    if (!planes) {
      must(!planes.error().what.empty());
      continue;
    }
    for (int k = 0; k < grid.dims[2]; ++k)
      planes->read_slice(k, [&](std::size_t voxel) { must(voxel < 16 * 12); });
  }
}

// the same bytes as a segmentation
void inspect_segmentation(const std::string& name, const std::string& syntax) {
  const auto declared = library().read_segmentation(name, syntax);
  if (!declared) return must(!declared.error().what.empty());
  must(declared->frames.size() == declared->segment_of_frame.size());
  for (const DicomSegment& segment : declared->segments) must(!name_of_segment(segment).empty());
  const auto grid = segment_grid_of(*declared);
  if (!grid) return must(!grid.error().what.empty());
  must(grid->geometry.min_spacing_mm() > 0 && grid->slice_of_frame.size() == declared->frames.size());
  for (const int slice : grid->slice_of_frame) must(slice >= 0 && slice < grid->geometry.dims[2]);
  auto pixels = library().open_pixels(name);
  const DicomFrame& frame = declared->frames.back();
  const auto count = static_cast<std::size_t>(frame.rows) * static_cast<std::size_t>(frame.columns);
  if (!pixels || count > std::size_t{1} << 16) return;
  std::vector<std::int64_t> values(count);
  if (!(*pixels)->read(frame, values)) return;
  for (const std::int64_t value : values) must(value >= 0 && value < 65536);
}

}  // namespace

// A length claimed by a file is allocated before the data are found missing, as in the confined process,
// whose memory limit rejects it.
extern "C" const char* __asan_default_options() {
  return "allocator_may_return_null=1:max_allocation_size_mb=256";
}

// one file: its attributes, all frames, and the voxels of the first frame
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const NamedBytes bytes(data, size);
  if (const auto found = library().read_identifiers(bytes.name()))
    for (const DicomIdentifier& one : *found)
      must(static_cast<std::size_t>(one.kind) < kIdentifierKinds && !one.what.empty());
  if (const auto files = library().read_directory(bytes.name())) must(!files->empty());
  const std::string front(reinterpret_cast<const char*>(data), std::min(size, kKindBytes));
  inspect_segmentation(bytes.name(), dicom_transfer_syntax(front));
  inspect_structures(bytes.name());
  const auto file = library().read_file(bytes.name(), dicom_transfer_syntax(front));
  if (!file) {
    must(!file.error().what.empty());
    return 0;
  }
  for (const DicomVolume& volume : sort_into_volumes(file->frames)) {
    must(!volume.frames.empty() && !volume.what.empty());
    if (!volume.fault.empty()) {
      must(!volume.remedy.empty());
      continue;
    }
    must(volume.geometry.min_spacing_mm() > 0 && volume.frames.size() > 1);
    must(volume.geometry.dims[2] == static_cast<int>(volume.frames.size()));
  }
  auto pixels = library().open_pixels(bytes.name());
  if (!pixels) return 0;
  constexpr std::size_t kMaxFrames = 4, kMaxValues = 1 << 16;
  for (std::size_t n = 0; n < std::min(file->frames.size(), kMaxFrames); ++n) {
    const DicomFrame& frame = file->frames[n];
    const auto count = static_cast<std::size_t>(frame.rows) * static_cast<std::size_t>(frame.columns);
    if (!frame.fault.empty() || count > kMaxValues) continue;
    std::vector<std::int64_t> values(count);
    if (!(*pixels)->read(frame, values) || frame.padding) continue;
    const std::int64_t lowest = frame.is_signed ? -(std::int64_t{1} << (frame.bits_stored - 1)) : 0;
    const std::int64_t width = std::int64_t{1} << frame.bits_stored;
    for (const std::int64_t value : values) must(value >= lowest && value < lowest + width);
  }
  return 0;
}
