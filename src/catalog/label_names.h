#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "palpate/base/result.h"

namespace palpate {

/// MRIcron's list of names, "number name ..." a line, as a table with the columns value and name.
/// `source` names the text in errors, which carry the line.
Result<std::string> mricron_names_to_tsv(std::string_view text, const std::string& source);

/// Keeps that table of `list` at `table`, made anew when it is missing or another one.
Result<void> keep_mricron_names(const std::filesystem::path& list, const std::filesystem::path& table);

}  // namespace palpate
