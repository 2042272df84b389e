#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

#include "recording/stream.h"

namespace palpate::internal {

/// Ticks in a row, without their events: as many as there are of `count` from row `first` on.
struct RowRange {
  std::uint64_t first = 0, count = 0;
};

/// Opens a recording with HDF5, checks every name, type and shape in it and sends it, or a refusal.
/// False when it had to stop half-way. Call it inside an Hdf5Section, for a file that may be hostile in a
/// process that may die.
/// @param range  nothing: all of it. Else the head is of these ticks alone, and has no summary
bool send_recording(const std::filesystem::path& file, ByteTarget& target,
                    std::optional<RowRange> range = std::nullopt);

}  // namespace palpate::internal
