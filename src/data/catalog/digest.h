#pragma once

#include <filesystem>
#include <string>

#include "palpate/base/result.h"

namespace palpate {

/// SHA-256 of a file's content, lower-case hexadecimal.
Result<std::string> sha256_of_file(const std::filesystem::path& file);

/// Git object id of a file: SHA-1 of "blob <size>\0" and the content, lower-case hexadecimal.
Result<std::string> git_blob_of_file(const std::filesystem::path& file);

}  // namespace palpate
