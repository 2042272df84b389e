#include <algorithm>
#include <set>

#include "volume_io/labels/label_text.h"
#include "volume_io/voxel_source.h"

namespace palpate {

using namespace volume_io;

namespace {

constexpr std::size_t kNowhere = ~std::size_t{0};

// column indices
struct Columns {
  std::size_t value = kNowhere, name = kNowhere, r = kNowhere, g = kNowhere, b = kNowhere, colour = kNowhere;
  std::size_t count = 0;
};

// splits a line into columns; with quotation marks for CSV only
using Split = Result<std::vector<std::string>> (*)(std::string_view line, char separator,
                                                   const std::string& where);

Result<std::vector<std::string>> split_plain(std::string_view line, char separator, const std::string&) {
  std::vector<std::string> fields;
  for (const std::string_view field : split_at(line, separator)) fields.emplace_back(field);
  return fields;
}

// RFC 4180 with one row per line
Result<std::vector<std::string>> split_quoted(std::string_view line, char separator,
                                              const std::string& where) {
  std::vector<std::string> fields(1);
  bool quoted = false;
  for (std::size_t n = 0; n < line.size(); ++n) {
    const char c = line[n];
    const bool twice = quoted && c == '"' && n + 1 < line.size() && line[n + 1] == '"';
    if (twice) ++n;
    if (c == '"' && !twice)
      quoted = !quoted;
    else if (c == separator && !quoted)
      fields.emplace_back();
    else
      fields.back() += c;
  }
  if (quoted) return bad_input(where, "has a quotation mark that is never closed");
  return fields;
}

Result<Columns> parse_heading(const std::vector<std::string>& fields, const std::string& where) {
  Columns columns;
  columns.count = fields.size();
  for (std::size_t n = 0; n < fields.size(); ++n) {
    const std::string heading = lower_case(trimmed(fields[n]));
    const auto is_one_of = [&](std::initializer_list<const char*> names) {
      return std::find(names.begin(), names.end(), heading) != names.end();
    };
    std::size_t* column = nullptr;
    if (is_one_of({"value", "index", "label", "id", "labelvalue", "label value", "label_value", "label_id"}))
      column = &columns.value;
    if (is_one_of({"name", "label name", "label_name", "labelname"})) column = &columns.name;
    if (is_one_of({"r", "red", "color_r"})) column = &columns.r;
    if (is_one_of({"g", "green", "color_g"})) column = &columns.g;
    if (is_one_of({"b", "blue", "color_b"})) column = &columns.b;
    if (heading == "color" || heading == "colour") column = &columns.colour;
    if (column == nullptr) continue;
    if (*column != kNowhere)
      return bad_input(where, "two columns are for the " + heading, "keep one of them");
    *column = n;
  }
  if (columns.value == kNowhere || columns.name == kNowhere)
    return bad_input(
        where, "the first line has no 'value' and 'name' columns",
        "start with a header line with the columns value and name (index, label and id also mean value)");
  const int rgb = (columns.r != kNowhere) + (columns.g != kNowhere) + (columns.b != kNowhere);
  if (rgb != 0 && rgb != 3) return bad_input(where, "has only some of the columns r, g and b");
  return columns;
}

// #rrggbb
std::optional<Rgb> parse_hex_colour(std::string_view text) {
  if (text.size() != 7 || text[0] != '#') return std::nullopt;
  std::uint8_t part[3];
  for (std::size_t c = 0; c < 3; ++c) {
    const char* first = text.data() + 1 + 2 * c;
    const auto result = std::from_chars(first, first + 2, part[c], 16);
    if (result.ec != std::errc() || result.ptr != first + 2) return std::nullopt;
  }
  return Rgb{part[0], part[1], part[2]};
}

// colour of a row; nullopt without one ("n/a" in BIDS)
Result<std::optional<Rgb>> parse_colour(const Columns& columns, const std::vector<std::string>& fields,
                                        const std::string& where) {
  const auto missing = [](std::string_view text) { return text.empty() || text == "n/a"; };
  if (columns.r != kNowhere) {
    const std::string_view r = trimmed(fields[columns.r]), g = trimmed(fields[columns.g]),
                           b = trimmed(fields[columns.b]);
    if (missing(r) && missing(g) && missing(b)) return std::optional<Rgb>();
    const auto red = parse_number<std::uint8_t>(r), green = parse_number<std::uint8_t>(g),
               blue = parse_number<std::uint8_t>(b);
    if (!red || !green || !blue) return bad_input(where, "a colour is not a whole number in 0 ... 255");
    return std::optional(Rgb{*red, *green, *blue});
  }
  if (columns.colour == kNowhere || missing(trimmed(fields[columns.colour]))) return std::optional<Rgb>();
  const auto colour = parse_hex_colour(trimmed(fields[columns.colour]));
  if (!colour) return bad_input(where, "the colour is not of the form #rrggbb");
  return colour;
}

Result<std::vector<NamedLabel>> parse_table(std::string_view text, char separator, Split split,
                                            const std::string& source) {
  const auto heading = split(read_line(text), separator, source + ":1");
  if (!heading) return heading.error();
  const auto columns = parse_heading(*heading, source + ":1");
  if (!columns) return columns.error();

  std::vector<NamedLabel> labels;
  std::set<LabelId> used_labels;
  for (int number = 2; !text.empty(); ++number) {
    const std::string_view line = read_line(text);
    if (trimmed(line).empty()) continue;
    const std::string where = source + ":" + std::to_string(number);
    const auto fields = split(line, separator, where);
    if (!fields) return fields.error();
    if (fields->size() != columns->count)
      return bad_input(where,
                       "has " + std::to_string(fields->size()) + " columns, but the header line has " +
                           std::to_string(columns->count),
                       separator == '\t' ? "separate columns by one tab each"
                                         : "put a name with a comma in quotation marks");
    const auto value = parse_number<LabelId>(trimmed((*fields)[columns->value]));
    if (!value) return bad_input(where, "the value is not a whole number in 0 ... 65535");
    if (!used_labels.insert(*value).second)
      return bad_input(where, "value " + std::to_string(*value) + " is named a second time",
                       "keep one of the lines");
    const std::string_view name = trimmed((*fields)[columns->name]);
    if (auto fault = name_fault(name)) return bad_input(where, *fault, "rename the structure");
    const auto colour = parse_colour(*columns, *fields, where);
    if (!colour) return colour.error();
    labels.push_back({*value, std::string(name), *colour});
  }
  return labels;
}

std::string_view without_byte_order_mark(std::string_view text) {
  constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
  if (text.starts_with(kByteOrderMark)) text.remove_prefix(kByteOrderMark.size());
  return text;
}

}  // namespace

Result<std::vector<NamedLabel>> parse_label_tsv(std::string_view text, const std::string& source) {
  return parse_table(without_byte_order_mark(text), '\t', split_plain, source);
}

Result<std::vector<NamedLabel>> parse_label_csv(std::string_view text, const std::string& source) {
  text = without_byte_order_mark(text);
  // spreadsheets write semicolons in locales with a decimal comma
  const std::string_view heading = text.substr(0, text.find('\n'));
  const bool semicolons =
      heading.find(',') == std::string_view::npos && heading.find(';') != std::string_view::npos;
  return parse_table(text, semicolons ? ';' : ',', split_quoted, source);
}

}  // namespace palpate
