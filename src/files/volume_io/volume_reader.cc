#include "volume_io/volume_reader.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <stdexcept>
#include <utility>
#include <variant>

#include "volume_io/dicom/dicom.h"
#include "volume_io/dicom/dicom_volumes.h"
#include "volume_io/formats/formats.h"
#include "volume_io/labels/masks.h"
#include "volume_io/mesh/meshes.h"
#include "volume_io/volume_message.h"
#include "volume_io/voxel_stream.h"

namespace palpate::volume_io {
namespace {

// ---- in the reader process ----------------------------------------------------------------------

bool serve_volume(reader::ParentEnd& parent, const Format& format, Files files, OtherFiles others,
                  const PlacementOptions& placement_options) {
  const auto volume = inspect_file(format, files.front(), others, placement_options);
  if (others.requested()) return send_file_request(parent, *others.requested());
  if (!volume) return send_refusal(parent, volume.error());
  if (!send_volume(parent, *volume, files)) return false;
  while (parent.wait_for_grant()) {
    VoxelSlots slots(parent);
    const auto read = send_voxels(*volume, slots);
    slots.drain();
    if (!send_end(parent, read)) return false;
  }
  return false;
}

// ---- in the parent process ----------------------------------------------------------------------

Result<std::unique_ptr<reader::ReaderProcess>> start(const std::vector<InputFile>& files,
                                                     std::size_t shared_bytes, const Progress& progress,
                                                     const reader::ReaderProcess::Work& work) {
  std::vector<int> descriptors;
  for (const InputFile& file : files) descriptors.push_back(file.descriptor());
  return start_reader(descriptors, shared_bytes, progress, work);
}

// adds the slice at which reading DICOM failed
Error at_slice(Error error, const VolumeFile& file, std::uint64_t values) {
  const GridGeometry& grid = file.header.geometry;
  if (file.voxels.encoding != Encoding::kSlices || error.kind != ErrorKind::kBadInput) return error;
  const auto slice = static_cast<std::uint64_t>(grid.dims[0]) * static_cast<std::uint64_t>(grid.dims[1]);
  const std::uint64_t last = static_cast<std::uint64_t>(grid.dims[2]) - 1;
  error.what =
      slice_in_words(grid, static_cast<std::size_t>(std::min(values / slice, last))) + ", " + error.what;
  return error;
}

}  // namespace

std::span<std::byte> VoxelSlots::buffer() {
  if (filled_ == kSlots) wait();
  return parent_.shared().subspan(next_ * kSlotBytes, kSlotBytes);
}

void VoxelSlots::commit(std::size_t bytes) {
  write_number(static_cast<std::uint32_t>(bytes));
  next_ = (next_ + 1) % kSlots;
  ++filled_;
}

void VoxelSlots::drain() {
  while (filled_ > 0) wait();
}

void VoxelSlots::wait() {
  if (!parent_.wait_for_grant()) throw std::runtime_error("no grant");
  --filled_;
}

void VoxelSlots::write_number(std::uint32_t number) {
  if (!parent_.write(std::as_bytes(std::span(&number, 1))))
    throw std::runtime_error("reading was interrupted");
}

Result<std::unique_ptr<reader::ReaderProcess>> start_reader(std::span<const int> descriptors,
                                                            std::size_t shared_bytes,
                                                            const Progress& progress,
                                                            const reader::ReaderProcess::Work& work) {
  reader::ReaderProcess::Job job;
  job.files = descriptors;
  job.shared_bytes = shared_bytes;
  job.death_error = "is damaged: its reader fails to read it";
  job.timeout_error = "is damaged: its reader does not finish";
  return reader::ReaderProcess::start(job, work, progress);
}

Result<VolumeReader> VolumeReader::open(const std::filesystem::path& file, const Progress& progress,
                                        std::optional<int> number, const GridGeometry* grid,
                                        const PlacementOptions& placement_options, ImageColours colours) {
  const bool segmentation = !dicom_segmentation_files(file).empty(),
             structures = grid && is_dicom_structures(file);
  if (is_dicom(file) || ((segmentation || structures) && !number)) {
    auto dicom = segmentation ? open_dicom_segmentation(file, progress)
                 : structures ? open_dicom_structures(file, *grid, progress)
                              : open_dicom(file, number, progress);
    if (!dicom) return dicom.error();
    VolumeReader reader(progress);
    reader.names_.push_back(file);
    reader.process_ = std::move(dicom->process);
    reader.volume_ = std::move(dicom->volume);
    reader.volume_.header.format = segmentation ? "DICOM segmentation"
                                   : structures ? "DICOM structure set"
                                                : "DICOM";
    reader.volume_.header.component_type = name_of(reader.volume_.voxels.component);
    return reader;
  }
  const bool meshes = !number && is_meshes(file);
  if (meshes || (!number && is_masks(file))) {
    auto labels = meshes ? open_meshes(file, grid, placement_options.mesh, progress)
                         : open_masks(file, placement_options, progress);
    if (!labels) return labels.error();
    VolumeReader reader(progress);
    reader.names_.push_back(file);
    reader.process_ = std::move(labels->process);
    reader.volume_ = std::move(labels->volume);
    reader.volume_.header.format = meshes ? "surfaces" : "masks";
    reader.volume_.header.component_type = name_of(reader.volume_.voxels.component);
    return reader;
  }
  if (!number && is_image_stack(file)) {
    auto stack = open_image_stack(file, placement_options.image_spacing_mm, colours, progress);
    if (!stack) return stack.error();
    VolumeReader reader(progress);
    reader.names_.push_back(file);
    reader.process_ = std::move(stack->process);
    reader.volume_ = std::move(stack->volume);
    reader.volume_.header.format = reader.volume_.header.has_segments ? kColouredPictures : "pictures";
    reader.volume_.header.component_type = name_of(reader.volume_.voxels.component);
    return reader;
  }
  if (auto error = not_a_file(file)) return *std::move(error);
  // pipe, device, socket or unreadable file
  auto opened = InputFile::open(file);
  if (!opened) return opened.error();
  if (number)
    return Error{ErrorKind::kUsage, "holds one volume, which has no number", file.string(),
                 "leave out the number: only DICOM files hold several"};
  const auto format = format_of(file);
  if (!format) {
    const auto kind = file_kind_of(file, unpacked_front);
    return kind ? bad_input(file.string(), "is " + kind->what, kind->remedy) : format.error();
  }

  VolumeReader reader(progress);
  reader.names_.push_back(file);
  reader.files_.push_back(*std::move(opened));
  OtherFiles others;
  // an .img, its .hdr, and the .img that this one requests
  constexpr std::size_t kMaxFiles = 3;
  while (true) {
    auto process = start(reader.files_, kSlots * kSlotBytes, progress, [&](reader::ParentEnd& parent) {
      return serve_volume(parent, **format, reader.names_, others, placement_options);
    });
    if (!process) return Error{process.error().kind, process.error().what, file.string(), ""};
    auto answer = receive_answer(**process, reader.names_);
    if (!answer) return answer.error();
    if (auto* volume = std::get_if<VolumeFile>(&*answer)) {
      if (volume->voxels.encoding == Encoding::kSlices) return impossible_volume(reader.names_);
      reader.process_ = *std::move(process);
      reader.volume_ = std::move(*volume);
      name_format(**format, reader.volume_);
      return reader;
    }
    // restart with access to this file too
    if (reader.files_.size() == kMaxFiles) return impossible_volume(reader.names_);
    auto& requested = std::get<OtherFile>(*answer);
    const auto other = find_other_file(file, requested);
    if (!other) return other.error();
    auto other_opened = InputFile::open(*other);
    if (!other_opened) return other_opened.error();
    reader.names_.push_back(*other);
    reader.files_.push_back(*std::move(other_opened));
    others.add(std::move(requested), *other);
  }
}

const InputFile& VolumeReader::voxel_file() const {
  const auto named = std::find(names_.begin(), names_.end(), volume_.voxels.file);
  PALPATE_CHECK(named != names_.end());
  return files_[static_cast<std::size_t>(named - names_.begin())];
}

Result<void> VolumeReader::stream(const VoxelConsumer& take) {
  PALPATE_CHECK(process_ != nullptr);
  auto used = read_voxels(*process_, volume_, names_, *progress_, take);
  if (!used) process_ = nullptr;
  return used;
}

Result<void> read_voxels(reader::ReaderProcess& process, const VolumeFile& file, Files files,
                         const Progress& progress, const VoxelConsumer& take) {
  const std::size_t size = bytes_of(file.voxels.component);
  const std::uint64_t count = file.value_count();
  std::vector<std::byte> piece(kPieceValues * size);
  std::uint64_t first = 0;
  process.resume();
  for (std::size_t slot = 0;;) {
    std::uint32_t bytes = 0;
    if (auto received = process.read(std::as_writable_bytes(std::span(&bytes, 1))); !received)
      return about(at_slice(received.error(), file, first), files);
    if (bytes == kEnd) break;
    if (bytes == kStillReading) continue;
    if (bytes > piece.size() || bytes % size != 0 || bytes / size > count - first)
      return impossible_volume(files);
    // a private copy, which the reader process cannot change during validation
    const auto values = std::span(piece).first(bytes);
    std::memcpy(values.data(), process.shared().data() + slot * kSlotBytes, bytes);
    process.resume();
    slot = (slot + 1) % kSlots;
    if (auto used = take(first, values); !used) return used;
    first += bytes / size;
    progress.report("reading", static_cast<double>(first) / static_cast<double>(count));
  }
  if (auto whole = receive_end(process, files); !whole) return whole;
  if (first != count) return impossible_volume(files);
  return {};
}

std::string unpacked_front(const std::filesystem::path& file, std::size_t bytes) {
  std::vector<InputFile> files;
  if (auto opened = InputFile::open(file)) files.push_back(*std::move(opened));
  if (files.empty()) return "";
  const Progress silent;
  const auto process = start(files, 0, silent, [&](reader::ParentEnd& parent) {
    const auto front = read_front(file, Encoding::kDeflate, bytes);
    reader::Sender out(parent);
    out.put(front ? *front : std::string());
    return out.ok();
  });
  if (!process) return "";
  std::string front;
  reader::Receiver in(**process, "");
  in.get(front, bytes);
  return front;
}

}  // namespace palpate::volume_io
