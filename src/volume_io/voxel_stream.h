#pragma once

#include <cstddef>
#include <span>
#include <string>

#include "volume_io/voxel_source.h"

namespace palpate::volume_io {

/// The first `bytes` decoded bytes of a file, or all when it has fewer.
Result<std::string> read_front(const std::filesystem::path& file, Encoding encoding, std::size_t bytes);

/// Where stored values go, one after the other, in the machine's byte order.
class VoxelSink {
 public:
  virtual ~VoxelSink() = default;
  /// The place for the next values, kPieceValues of any type at least, until they are put.
  virtual std::span<std::byte> room() = 0;
  /// So many bytes of whole values are there.
  virtual void put(std::size_t bytes) = 0;
  /// Called now and then where much is read before there are values to put.
  virtual void still_reading() = 0;
};
constexpr std::size_t kPieceValues = std::size_t{1} << 17;

/// An error unless the file can hold what its header promises and the process may have the volume with
/// `bytes_per_value` each, and with `besides`. Looks at sizes only; comes before anything is allocated.
Result<void> check_plausible(const VolumeFile& file, std::size_t bytes_per_value, std::uint64_t besides = 0);

/// Reads every voxel value once, in file order. Short, damaged or surplus data are errors that say so.
/// The bytes may do anything to whoever does this: volume_reader.h has a process for it.
Result<void> send_voxels(const VolumeFile& file, VoxelSink& sink);

}  // namespace palpate::volume_io
