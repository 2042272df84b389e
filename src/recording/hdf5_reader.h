#pragma once

#include <filesystem>

#include "recording/stream.h"

namespace palpate::internal {

/// Opens a recording with HDF5, checks every name, type and shape in it and sends it, or a refusal.
/// False when it had to stop half-way. Call it inside an Hdf5Section, for a file that may be hostile in a
/// process that may die.
bool send_recording(const std::filesystem::path& file, ByteTarget& target);

}  // namespace palpate::internal
