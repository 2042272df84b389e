#include "volume_io/label_names.h"

#include <algorithm>

#include "base/file.h"
#include "volume_io/formats.h"

namespace palpate {

using namespace volume_io;

Result<std::vector<NamedLabel>> read_label_names(const std::filesystem::path& file) {
  const bool table = has_ending(file, ".ctbl") || has_ending(file, ".txt");
  if (!table && !has_ending(file, ".tsv"))
    return bad_input(file.string(), "is of no table format that is read here", "use .ctbl, .txt or .tsv");
  constexpr std::size_t kMostBytes = std::size_t{1} << 24;
  const auto text = read_file(file, kMostBytes);
  if (!text) return text.error();
  return table ? parse_colour_table(*text, file.string()) : parse_label_tsv(*text, file.string());
}

namespace volume_io {

std::optional<std::filesystem::path> only_table_beside(const std::filesystem::path& file) {
  const auto folder = file.parent_path().empty() ? std::filesystem::path(".") : file.parent_path();
  std::vector<std::filesystem::path> tables;
  std::error_code failed;
  std::filesystem::directory_iterator entries(folder, failed);
  for (; !failed && entries != std::filesystem::directory_iterator(); entries.increment(failed))
    if (has_ending(entries->path(), ".ctbl") || has_ending(entries->path(), ".tsv"))
      tables.push_back(entries->path());
  if (failed || tables.size() != 1) return std::nullopt;
  return tables.front();
}

}  // namespace volume_io
}  // namespace palpate
