#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "palpate/base/result.h"

namespace palpate {

/// Converts MRIcron's list of names, "number name ..." per line, to a table with the columns value and name.
/// `source` names the text in errors, which include the line number.
Result<std::string> mricron_names_to_tsv(std::string_view text, const std::string& source);

/// Converts the file `list` to the table file `table`, unless that is up to date.
Result<void> update_names_table(const std::filesystem::path& list, const std::filesystem::path& table);

}  // namespace palpate
