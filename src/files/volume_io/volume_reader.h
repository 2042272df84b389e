#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "palpate/base/file.h"
#include "palpate/reader/reader_process.h"
#include "volume_io/image/image_stack.h"
#include "volume_io/volume_message.h"
#include "volume_io/voxel_source.h"
#include "volume_io/voxel_stream.h"

/// Reads a volume by a confined process (reader_process.h): palpate parses the header, zlib and libbz2
/// decompress the voxels. The parent receives the header's fields and the stored values (volume_message.h),
/// which it copies piece by piece from shared memory: the volume is held in memory once.
///
///   parent                                            reader process
///     opens the file, starts it                       may open this file only
///                          ◄─ volume, request,
///                             refusal ─────────────── parses the header
///     on a request: locates and opens the
///     other file, restarts with both
///     requests the voxels ─ grant ──────────────────► for each piece:
///                          ◄─ "slot n is filled" ──── fills slot n, initially free
///     copies it, "it is free" ─ grant ──────────────►
///     converts the values
namespace palpate::volume_io {

/// Receives consecutive stored values, in the machine's byte order: the index of the first in the file and
/// their bytes. A returned Error aborts the read, which returns it.
using VoxelConsumer = std::function<Result<void>(std::uint64_t first, std::span<const std::byte> values)>;

/// A volume; its files stay open while this object lives.
class VolumeReader {
 public:
  /// Parses the header. Errors: missing; not a regular file; unknown format; invalid header.
  /// @param progress           must outlive this object at the same address
  /// @param number             number of the volume, if the file or folder is DICOM
  /// @param grid               grid for contours, which have none of their own; null: those are an error.
  ///                           Used for surfaces too
  /// @param placement_options  for surfaces, image stacks and NIfTI
  /// @param colours            interpretation of colour images
  static Result<VolumeReader> open(const std::filesystem::path& file, const Progress& progress,
                                   std::optional<int> number = {}, const GridGeometry* grid = nullptr,
                                   const PlacementOptions& placement_options = {},
                                   ImageColours colours = ImageColours::kLabels);

  const VolumeFile& file() const { return volume_; }
  /// File that contains the voxels, as it was opened; not available for DICOM, which may consist of many.
  const InputFile& voxel_file() const;
  /// Streams every voxel; may be called repeatedly, but not after an error. Errors: truncated or damaged
  /// data; surplus data; interrupted; those of `take`.
  Result<void> stream(const VoxelConsumer& take);

 private:
  explicit VolumeReader(const Progress& progress) : progress_(&progress) {}

  const Progress* progress_;
  // the file named by the user first
  std::vector<std::filesystem::path> names_;
  std::vector<InputFile> files_;
  std::unique_ptr<reader::ReaderProcess> process_;
  VolumeFile volume_;
};

/// Number of slots for pieces of values in ReaderProcess::shared(). Sixteen slots were not faster than four,
/// which fit into a cache.
constexpr std::size_t kSlots = 4;
constexpr std::size_t kSlotBytes = kPieceValues * sizeof(double);

/// Starts a reader process with access to `descriptors`, and runs `work` in it.
Result<std::unique_ptr<reader::ReaderProcess>> start_reader(std::span<const int> descriptors,
                                                            std::size_t shared_bytes,
                                                            const Progress& progress,
                                                            const reader::ReaderProcess::Work& work);

/// Shared-memory slots in the reader process, filled in turn. Throws if the parent accepts no more data.
class VoxelSlots : public VoxelSink {
 public:
  explicit VoxelSlots(reader::ParentEnd& parent) : parent_(parent) {}
  std::span<std::byte> buffer() override;
  void commit(std::size_t bytes) override;
  void still_reading() override { write_number(kStillReading); }
  /// Returns once the parent has copied all slots.
  void drain();

 private:
  void wait();
  void write_number(std::uint32_t number);

  reader::ParentEnd& parent_;
  std::size_t next_ = 0, filled_ = 0;
};

/// Parent's half of VolumeReader::stream(). Validates everything that the reader process sends.
Result<void> read_voxels(reader::ReaderProcess& process, const VolumeFile& file, Files files,
                         const Progress& progress, const VoxelConsumer& take);

/// First decompressed bytes of a gzip file, read by a reader process; empty if there are none.
std::string unpacked_front(const std::filesystem::path& file, std::size_t bytes);

}  // namespace palpate::volume_io
