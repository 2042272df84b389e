#pragma once

#include <filesystem>
#include <span>

#include "palpate/result.h"

namespace palpate {

/// Whether two names mean one file: spelled differently, through links, and also where no file is yet.
bool same_file(const std::filesystem::path& a, const std::filesystem::path& b);

/// Whether a file of that name could be written now: its folder exists and takes files, and it is not a
/// folder or a device itself. Asked before long work, so that a wrong name costs nothing. Leaves nothing
/// behind.
/// @param never  files that are read for it and that it must not replace
/// Errors: kUsage when it is one of `never`, kOutput otherwise.
Result<void> check_output(const std::filesystem::path& file,
                          std::span<const std::filesystem::path> never = {});

}  // namespace palpate
