#pragma once

#include <cstddef>
#include <span>
#include <string>

#include "volume_io/voxel_source.h"

namespace palpate::volume_io {

/// First `bytes` decoded bytes of a file, or all if there are fewer.
Result<std::string> read_front(const std::filesystem::path& file, Encoding encoding, std::size_t bytes);

/// Receiver of consecutive stored values, in the machine's byte order.
class VoxelSink {
 public:
  virtual ~VoxelSink() = default;
  /// Buffer for the next values, at least kPieceValues of any type, valid until commit().
  virtual std::span<std::byte> buffer() = 0;
  /// Appends `bytes` bytes of whole values from the buffer.
  virtual void commit(std::size_t bytes) = 0;
  /// Called regularly while much data is read without producing values.
  virtual void still_reading() = 0;
};
constexpr std::size_t kPieceValues = std::size_t{1} << 17;

/// Checks, before anything is allocated, that the file is large enough for what its header promises, and that
/// the process may allocate the volume with `bytes_per_value` each plus `besides` bytes. Compares sizes only.
Result<void> check_plausible(const VolumeFile& file, std::size_t bytes_per_value, std::uint64_t besides = 0);

/// Reads every voxel value once, in file order. Errors: truncated, damaged or surplus data. Untrusted bytes
/// may compromise the process: call it in a reader process (volume_reader.h).
Result<void> send_voxels(const VolumeFile& file, VoxelSink& sink);

}  // namespace palpate::volume_io
