#pragma once

#include <functional>
#include <span>

#include "volume_io/voxel_source.h"

namespace palpate::volume_io {

/// The first `bytes` decoded bytes of a file, or all when it has fewer.
Result<std::string> read_front(const std::filesystem::path& file, Encoding encoding, std::size_t bytes);

/// Receives consecutive stored values, in the machine's byte order: the index of the first in the file
/// and their bytes. An Error stops the reading and is returned from it.
using TakeVoxels = std::function<Result<void>(std::uint64_t first, std::span<const std::byte> values)>;

/// An error unless the file can hold what its header promises and the process may have the volume with
/// `bytes_per_value` each, and with `besides`. Looks at sizes only; comes before anything is allocated.
Result<void> check_plausible(const VolumeFile& file, std::size_t bytes_per_value, std::uint64_t besides = 0);

/// Reads every voxel value once, in file order. Short, damaged or surplus data are errors that say so.
Result<void> stream_voxels(const VolumeFile& file, const Progress& progress, const TakeVoxels& take);

}  // namespace palpate::volume_io
