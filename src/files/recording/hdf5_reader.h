#pragma once

#include <filesystem>
#include <optional>

#include "recording/hdf5_reading.h"
#include "recording/stream.h"

namespace palpate::internal {

/// Opens a recording with HDF5, validates every name, type and shape in it, and sends it or a refusal. False
/// if it failed half-way. Call it inside an Hdf5Section, and for untrusted files in a sandboxed process.
/// @param range  empty: the whole recording. Otherwise the head covers these ticks only and has no summary
bool send_recording(const std::filesystem::path& file, ByteTarget& target,
                    std::optional<RowRange> range = std::nullopt);

}  // namespace palpate::internal
