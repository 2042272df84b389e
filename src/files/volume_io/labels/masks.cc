#include "volume_io/labels/masks.h"

#include <cmath>
#include <cstdio>
#include <cstring>
#include <stdexcept>

#include "volume_io/component.h"
#include "volume_io/formats/formats.h"
#include "volume_io/labels/layered_labels.h"
#include "volume_io/voxel_runs.h"
#include "volume_io/voxel_stream.h"

namespace palpate::volume_io {
namespace {

namespace fs = std::filesystem;

// maximum number of masks: any two may overlap in every voxel
constexpr std::size_t kMaxMasks = 1024;

// a volume of two files is represented by its header
bool is_named_as_volume(const fs::path& file) {
  return format_of(file).ok() && !has_extension(file, ".img") && !has_extension(file, ".img.gz");
}

StructureFiles find_masks(const fs::path& folder) {
  return find_structure_files(folder, is_named_as_volume, "volume");
}

// ---- in the reader process ----------------------------------------------------------------------

// thrown when the parent has gone
struct ReaderStopped : std::runtime_error {
  ReaderStopped() : std::runtime_error("reading was interrupted") {}
};

/// Receives the voxels of one file and records those that are not 0.
class MaskSink final : public VoxelSink {
 public:
  MaskSink(const VolumeFile& file, const std::function<bool()>& should_continue)
      : file_(file),
        should_continue_(should_continue),
        slice_voxels_(static_cast<std::uint64_t>(file.header.geometry.dims[0]) *
                      static_cast<std::uint64_t>(file.header.geometry.dims[1])),
        piece_(kPieceValues * sizeof(double)) {}

  std::span<std::byte> buffer() override { return piece_; }
  void commit(std::size_t bytes) override {
    still_reading();
    with_type(file_.voxels.component, [&](auto type) { take<decltype(type)>(bytes); });
  }
  void still_reading() override {
    if (!should_continue_()) throw ReaderStopped();
  }
  /// Why the file is not a mask; empty if it is one.
  const std::string& fault() const { return fault_; }
  VoxelRuns take_runs() {
    while (ended_slices_ < file_.header.geometry.dims[2]) end_slice();
    return std::move(runs_);
  }

 private:
  template <class T>
  void take(std::size_t bytes) {
    for (std::size_t n = 0; n < bytes / sizeof(T); ++n, ++at_) {
      T typed;
      std::memcpy(&typed, piece_.data() + n * sizeof(T), sizeof(T));
      // most voxels equal their predecessor
      if (const auto stored = static_cast<double>(typed); stored != stored_ || at_ == 0) {
        stored_ = stored;
        inspect(file_.voxels.slope * stored + file_.voxels.intercept);
      }
      if (is_in_) add_voxel();
    }
  }
  void inspect(double value) {
    is_in_ = value != 0;
    if (!is_in_ || !fault_.empty()) return;
    if (!(value > 0 && value <= 65535 && value == std::floor(value))) {
      char text[32];
      std::snprintf(text, sizeof text, "%.6g", value);
      fault_ = std::string("has values that a mask cannot have, such as ") + text;
    } else if (number_ != 0 && value != number_) {
      fault_ = "has several values besides 0";
    }
    number_ = value;
  }
  void add_voxel() {
    const auto slice = static_cast<int>(at_ / slice_voxels_);
    while (ended_slices_ < slice) end_slice();
    runs_.add(static_cast<std::uint32_t>(at_ % slice_voxels_));
  }
  void end_slice() {
    runs_.end_slice();
    ++ended_slices_;
  }

  const VolumeFile& file_;
  const std::function<bool()>& should_continue_;
  const std::uint64_t slice_voxels_;
  std::vector<std::byte> piece_;
  std::uint64_t at_ = 0;
  double stored_ = 0, number_ = 0;
  bool is_in_ = false;
  int ended_slices_ = 0;
  std::string fault_;
  VoxelRuns runs_;
};

Error no_mask(const fs::path& file, const std::string& why) {
  return bad_input(file.string(), why + ", but in a folder of masks each file is one structure",
                   "give the intended file alone, or put the masks into a separate folder");
}

Result<VolumeFile> parse_mask_header(const fs::path& file, const PlacementOptions& placement_options) {
  const auto format = format_of(file);
  if (!format) return format.error();
  OtherFiles others;
  auto volume = inspect_file(**format, file, others, placement_options);
  if (others.requested()) return no_mask(file, "has its voxels in another file");
  if (volume && volume->header.layers > 1) return no_mask(file, "has several values for each voxel");
  return volume;
}

Result<StructureLabels> inspect_masks(const StructureFiles& found, const fs::path& named,
                                      const PlacementOptions& placement_options,
                                      const std::function<bool()>& should_continue, double& fraction) try {
  if (found.files.size() > kMaxMasks)
    return bad_input(named.string(),
                     "has " + std::to_string(found.files.size()) + " masks, but at most " +
                         std::to_string(kMaxMasks) + " can be read",
                     "give fewer of them");
  StructureLabels labels;
  GridGeometry grid;
  bool has_geometry = true;
  std::vector<std::string> empty, named_in_part;
  // parse all headers before any voxels are read
  std::vector<VolumeFile> files;
  for (const fs::path& one : found.files) {
    if (!should_continue()) throw ReaderStopped();
    auto file = parse_mask_header(one, placement_options);
    if (!file) return file.error();
    if (auto plausible = check_plausible(*file, sizeof(LabelId)); !plausible) return plausible.error();
    if (files.empty()) {
      grid = file->header.geometry;
    } else if (!file->header.geometry.same_grid(grid)) {
      return no_mask(one, "has a different grid from " + found.files.front().filename().string());
    }
    has_geometry = has_geometry && file->header.has_geometry;
    files.push_back(*std::move(file));
  }
  const std::string placement_doubt = files.empty() ? "" : files.front().header.placement_doubt;
  for (std::size_t n = 0; n < files.size(); ++n) {
    const fs::path& one = found.files[n];
    const VolumeFile* const file = &files[n];
    fraction = static_cast<double>(n) / static_cast<double>(files.size());
    MaskSink sink(*file, should_continue);
    if (auto read = send_voxels(*file, sink); !read) return read.error();
    if (!sink.fault().empty()) return no_mask(one, sink.fault());
    const auto [name, left_out] = name_of_structure(one, labels.names);
    if (left_out) named_in_part.push_back(name);
    labels.names.push_back(name);
    labels.voxels.push_back(sink.take_runs());
    if (labels.voxels.back().count() == 0) empty.push_back(name);
  }

  if (auto done = assign_to_layers(labels, grid, named, should_continue); !done) return done.error();
  labels.file.header.has_geometry = has_geometry;
  labels.file.header.placement_doubt = placement_doubt;
  auto& notes = labels.file.notes;
  notes.insert(notes.end(), found.notes.begin(), found.notes.end());
  if (!placement_doubt.empty()) notes.push_back(placement_doubt);
  if (!empty.empty()) notes.push_back("has masks without voxels: " + names_in_words(empty));
  if (!named_in_part.empty()) notes.push_back(note_of_left_out(named_in_part));
  return labels;
} catch (const ReaderStopped& stopped) {
  return bad_input("", stopped.what());
}

}  // namespace

std::vector<fs::path> volumes_in(const fs::path& folder) {
  std::error_code failed;
  if (!fs::is_directory(folder, failed)) return {};
  return find_masks(folder).files;
}

bool is_masks(const fs::path& folder) {
  return volumes_in(folder).size() >= 2 && !is_dicom(folder);
}

Result<LabelReader> open_masks(const fs::path& folder, const PlacementOptions& placement_options,
                               const Progress& progress) {
  const StructureFiles found = find_masks(folder);
  return open_structure_files(
      found, folder, progress,
      [&](const std::function<bool()>& should_continue, double& fraction) {
        return inspect_masks(found, folder, placement_options, should_continue, fraction);
      },
      "give fewer masks, or crop them first");
}

}  // namespace palpate::volume_io
