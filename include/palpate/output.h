#pragma once

#include <filesystem>

#include "palpate/result.h"

namespace palpate {

/// Whether a file of that name could be written now: its folder exists and takes files, and it is not a
/// folder or a device itself. Asked before long work, so that a wrong name costs nothing. Leaves nothing
/// behind. Errors are kOutput.
Result<void> check_output(const std::filesystem::path& file);

}  // namespace palpate
