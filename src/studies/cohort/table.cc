#include <algorithm>
#include <charconv>
#include <cmath>
#include <functional>
#include <set>

#include "palpate/base/printable.h"
#include "palpate/cohort/cohort_table.h"
#include "palpate/device/session_settings.h"
#include "palpate/scene/scene.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

std::string_view take_table_line(std::string_view& text) {
  const std::size_t end = text.find('\n');
  std::string_view line = text.substr(0, end);
  text.remove_prefix(end == text.npos ? text.size() : end + 1);
  if (line.ends_with('\r')) line.remove_suffix(1);
  return line;
}

std::string without_spaces_around(std::string_view text) {
  const auto first = text.find_first_not_of(" \t");
  if (first == text.npos) return "";
  return std::string(text.substr(first, text.find_last_not_of(" \t") - first + 1));
}

/// Fields of a line; empty if a quotation mark is not closed. In tab-separated tables quotation marks are
/// ordinary characters.
std::optional<std::vector<std::string>> fields_of(std::string_view line, char separator) {
  std::vector<std::string> fields(1);
  bool quoted = false;
  for (std::size_t n = 0; n < line.size(); ++n) {
    const char c = line[n];
    if (separator != '\t' && c == '"') {
      // a doubled quotation mark within a quoted field
      if (quoted && n + 1 < line.size() && line[n + 1] == '"')
        fields.back() += line[++n];
      else
        quoted = !quoted;
    } else if (c == separator && !quoted) {
      fields.emplace_back();
    } else {
      fields.back() += c;
    }
  }
  if (quoted) return std::nullopt;
  for (std::string& field : fields) {
    field = without_spaces_around(field);
    if (field == "n/a") field.clear();
  }
  return fields;
}

template <class T>
std::optional<T> number_of(const std::string& text, T low, T high) {
  T value{};
  const char* end = text.data() + text.size();
  const auto read = std::from_chars(text.data(), end, value);
  // false for NaN as well
  if (read.ec != std::errc() || read.ptr != end || !(value >= low && value <= high)) return std::nullopt;
  return value;
}

enum class Column {
  kCase,
  kTarget,
  kSegmentation,
  kNames,
  kScript,
  kVolume,
  kMethod,
  kMaxForce,
  kRate,
  kSeed
};
struct ColumnName {
  std::string_view name;
  Column column;
};
constexpr ColumnName kColumns[] = {
    {"case", Column::kCase},           {"study", Column::kTarget},  {"scan", Column::kTarget},
    {"scene", Column::kTarget},        {"target", Column::kTarget}, {"segmentation", Column::kSegmentation},
    {"labels", Column::kSegmentation}, {"names", Column::kNames},   {"script", Column::kScript},
    {"volume", Column::kVolume},       {"method", Column::kMethod}, {"max_force", Column::kMaxForce},
    {"rate", Column::kRate},           {"seed", Column::kSeed}};

Error at_line(const std::string& source, int line, std::string what, std::string remedy = "") {
  return {ErrorKind::kBadInput, std::move(what), source + ":" + std::to_string(line), std::move(remedy)};
}

/// Parses a field. Returns its error, or empty.
std::optional<std::string> put_field(Column column, const std::string& text, const fs::path& folder,
                                     const std::function<bool(const std::string&)>& is_data_set,
                                     CohortCase& one) {
  if (text.empty()) return std::nullopt;
  const auto below = [&](const std::string& file) { return folder / file; };
  const auto number = [&](auto& value, auto low, auto high) -> std::optional<std::string> {
    value = number_of<std::decay_t<decltype(*value)>>(text, low, high);
    if (value) return std::nullopt;
    char range[80];
    std::snprintf(range, sizeof range, "%g and %g", static_cast<double>(low), static_cast<double>(high));
    return "\"" + text + "\" is not a number between " + range;
  };
  switch (column) {
    case Column::kCase:
      if (text.size() > 100) return "a case's name may have at most 100 bytes";
      if (printable_name(text) != text) return "the case's name has characters that cannot be shown";
      one.name = text;
      return std::nullopt;
    case Column::kTarget:
      one.target = is_data_set && is_data_set(text) ? text : below(text).string();
      return std::nullopt;
    case Column::kSegmentation:
      one.segmentation = below(text);
      return std::nullopt;
    case Column::kNames:
      one.names = below(text);
      return std::nullopt;
    case Column::kScript:
      one.script = below(text);
      return std::nullopt;
    case Column::kVolume:
      return number(one.volume, 1, 100'000);
    case Column::kMethod:
      one.method = find_force_method(text);
      if (!one.method) return "\"" + text + "\" is not a force method";
      return std::nullopt;
    case Column::kMaxForce:
      return number(one.max_force_N, kMaxForceRange.min, kMaxForceRange.max);
    case Column::kRate:
      return number(one.rate_hz, 250.0, 10'000.0);
    case Column::kSeed:
      return number(one.seed, std::uint64_t{0}, std::uint64_t{9007199254740991});
  }
  return std::nullopt;
}

}  // namespace

Result<std::vector<CohortCase>> parse_cohort_table(
    std::string_view text, const std::string& source, const fs::path& folder,
    const std::function<bool(const std::string&)>& is_data_set) {
  std::vector<CohortCase> cases;
  std::vector<Column> columns;
  std::set<std::string> names;
  char separator = '\t';
  int number = 0;
  while (!text.empty()) {
    const std::string_view line = take_table_line(text);
    ++number;
    if (without_spaces_around(line).empty() || line.front() == '#') continue;
    if (columns.empty()) {
      separator = line.find('\t') != line.npos  ? '\t'
                  : line.find(';') != line.npos ? ';'
                  : line.find(',') != line.npos ? ','
                                                : '\t';
      const auto titles = fields_of(line, separator);
      if (!titles) return at_line(source, number, "a quotation mark is not closed");
      for (const std::string& title : *titles) {
        const auto known = std::ranges::find(kColumns, title, &ColumnName::name);
        if (known == std::end(kColumns))
          return at_line(
              source, number, "there is no column \"" + printable_name(title.substr(0, 60)) + "\"",
              "columns are study, segmentation, names, script, case, volume, method, max_force, rate, seed");
        if (std::ranges::find(columns, known->column) != columns.end())
          return at_line(source, number, "a column is repeated: " + title);
        columns.push_back(known->column);
      }
      if (std::ranges::find(columns, Column::kTarget) == columns.end())
        return at_line(source, number, "the column study is missing",
                       "add a column \"study\" with scans, DICOM folders, label maps, scenes or data sets");
      continue;
    }
    const auto fields = fields_of(line, separator);
    if (!fields) return at_line(source, number, "a quotation mark is not closed");
    if (fields->size() > columns.size())
      return at_line(source, number,
                     "has " + std::to_string(fields->size()) + " fields, but there are " +
                         std::to_string(columns.size()) + " columns");
    CohortCase one;
    one.line = number;
    for (std::size_t n = 0; n < fields->size(); ++n)
      if (const auto fault = put_field(columns[n], (*fields)[n], folder, is_data_set, one))
        return at_line(source, number, printable_name(*fault));
    if (one.target.empty()) return at_line(source, number, "the case has no study");
    if (one.name.empty()) one.name = std::to_string(cases.size() + 1);
    if (!names.insert(one.name).second)
      return at_line(source, number, "there are two cases \"" + one.name + "\"");
    if (cases.size() == kMaxCases)
      return at_line(source, number, "there are more than " + std::to_string(kMaxCases) + " cases");
    cases.push_back(std::move(one));
  }
  if (cases.empty())
    return Error{ErrorKind::kBadInput, "has no case", source,
                 "write a header line with the names of the columns, then one line per case"};
  return cases;
}

}  // namespace palpate
