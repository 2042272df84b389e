#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "palpate/base/file.h"
#include "palpate/reader/reader_process.h"
#include "volume_io/image_stack.h"
#include "volume_io/volume_message.h"
#include "volume_io/voxel_source.h"
#include "volume_io/voxel_stream.h"

/// A volume is read by a process of its own (reader_process.h): its header by us and ITK, its voxels through
/// zlib and libbz2. This process takes the header's fields and the stored values (volume_message.h), which it
/// copies piece by piece out of memory that both have: a volume is held once.
///
///   this process                                    the process that reads
///     opens the file, starts it                       may open this file alone
///                          ◄─ volume, wish, refusal ─ reads the header
///     a wish: finds the other file, opens
///     it, and starts anew with both
///     the voxels are wanted ─ word ─────────────────► for each piece:
///                          ◄─ "slot n is filled" ──── fills slot n, which is free at first
///     copies it, "it is free" ─ word ───────────────►
///     makes of the values what is wanted
namespace palpate::volume_io {

/// Receives consecutive stored values, in the machine's byte order: the index of the first in the file
/// and their bytes. An Error stops the reading and is returned from it.
using TakeVoxels = std::function<Result<void>(std::uint64_t first, std::span<const std::byte> values)>;

/// One volume, for as long as its files stay open.
class VolumeReader {
 public:
  /// Understands the header. Errors: missing, not a plain file, unknown format, and all that is wrong with
  /// the header.
  /// @param progress  stays where it is as long as this object lives
  /// @param number    of the volume, where the file or the folder is DICOM's
  /// @param grid      for contours, which have none of their own; null: those are an error. For surfaces too
  /// @param placing   of surfaces, stacks of pictures and NIfTI
  /// @param colours   what those of pictures mean
  static Result<VolumeReader> open(const std::filesystem::path& file, const Progress& progress,
                                   std::optional<int> number = {}, const GridGeometry* grid = nullptr,
                                   const Placing& placing = {}, ImageColours colours = ImageColours::kLabels);

  const VolumeFile& file() const { return volume_; }
  /// The file that the voxels stand in, as it was opened; of no DICOM, whose files are many.
  const InputFile& voxel_file() const;
  /// Streams every voxel, as often as it is called; after an error never again.
  /// Errors: data that end early or are damaged, surplus data, interrupted, and those of `take`.
  Result<void> stream(const TakeVoxels& take);

 private:
  explicit VolumeReader(const Progress& progress) : progress_(&progress) {}

  const Progress* progress_;
  // the one that the user named first
  std::vector<std::filesystem::path> names_;
  std::vector<InputFile> files_;
  std::unique_ptr<reader::ReaderProcess> process_;
  VolumeFile volume_;
};

/// Pieces of values on their way between the two processes, in ReaderProcess::shared(). Sixteen were no
/// faster than four, which stay in a cache.
constexpr std::size_t kSlots = 4;
constexpr std::size_t kSlotBytes = kPieceValues * sizeof(double);

/// Starts a process that may open these, and reads in it.
Result<std::unique_ptr<reader::ReaderProcess>> start_reader(std::span<const int> descriptors,
                                                            std::size_t shared_bytes,
                                                            const Progress& progress,
                                                            const reader::ReaderProcess::Work& work);

/// In the process that reads: the slots in turn. Throws where the parent takes no more.
class VoxelSlots : public VoxelSink {
 public:
  explicit VoxelSlots(reader::ParentEnd& parent) : parent_(parent) {}
  std::span<std::byte> room() override;
  void put(std::size_t bytes) override;
  void still_reading() override { say(kStillReading); }
  /// Returns when the parent has copied all of them.
  void drain();

 private:
  void wait();
  void say(std::uint32_t number);

  reader::ParentEnd& parent_;
  std::size_t next_ = 0, filled_ = 0;
};

/// This process's half of VolumeReader::stream(). It believes nothing of what the other one sends.
Result<void> take_voxels(reader::ReaderProcess& process, const VolumeFile& file, Files files,
                         const Progress& progress, const TakeVoxels& take);

/// The first unpacked bytes of a file that gzip has packed, read by such a process; none where there is none.
std::string unpacked_front(const std::filesystem::path& file, std::size_t bytes);

}  // namespace palpate::volume_io
