#include "catalog/label_names.h"

#include <charconv>

#include "palpate/base/file.h"

namespace palpate {
namespace {

// removes the next word from a line and returns it
std::string_view read_word(std::string_view& line) {
  constexpr std::string_view kSpace = " \t\r";
  line.remove_prefix(std::min(line.find_first_not_of(kSpace), line.size()));
  const std::string_view word = line.substr(0, line.find_first_of(kSpace));
  line.remove_prefix(word.size());
  return word;
}

}  // namespace

Result<std::string> mricron_names_to_tsv(std::string_view text, const std::string& source) {
  std::string table = "value\tname\n";
  int number = 0, labels = 0;
  while (!text.empty()) {
    std::string_view line = text.substr(0, text.find('\n'));
    text.remove_prefix(std::min(line.size() + 1, text.size()));
    ++number;
    const std::string_view value = read_word(line), name = read_word(line);
    if (value.empty()) continue;
    std::uint16_t label = 0;
    const auto [end, failed] = std::from_chars(value.data(), value.data() + value.size(), label);
    if (failed != std::errc() || end != value.data() + value.size() || name.empty())
      return Error{ErrorKind::kBadInput, "expected a label's number and its name",
                   source + ":" + std::to_string(number), "install the package mricron-data again"};
    table.append(value).append("\t").append(name).append("\n");
    ++labels;
  }
  if (labels == 0)
    return Error{ErrorKind::kBadInput, "names no label", source, "install the package mricron-data again"};
  return table;
}

Result<void> update_names_table(const std::filesystem::path& list, const std::filesystem::path& table) {
  constexpr std::size_t kMaxBytes = 1 << 20;
  const auto text = read_file(list, kMaxBytes);
  if (!text) return text.error();
  const auto converted = mricron_names_to_tsv(*text, list.string());
  if (!converted) return converted.error();
  const auto present = read_file(table, kMaxBytes);
  if (present && *present == *converted) return {};

  std::error_code failed;
  std::filesystem::create_directories(table.parent_path(), failed);
  if (failed) return output_error(table.parent_path(), failed.value());
  return write_file(table, *converted);
}

}  // namespace palpate
