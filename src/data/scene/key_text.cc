#include "scene/keys.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <numeric>

#include "palpate/scene/script.h"

namespace palpate {
namespace {

using enum KeyType;

std::string concat(std::initializer_list<std::string_view> parts) {
  std::string text;
  for (const std::string_view part : parts) text += part;
  return text;
}

std::string default_cell(const KeySpec& key) {
  if (key.type == kTable || key.type == kTables) return "";
  return key.default_text.empty() ? "—" : concat({"`", key.default_text, "`"});
}

std::string value_cell(const KeySpec& key) {
  if (key.choices.empty()) return std::string(type_text(key.type));
  std::string text;
  for (const std::string_view choice : key.choices)
    text += concat({text.empty() ? "" : ", ", "`\"", choice, "\"`"});
  return key.type == kDirection ? text + " or [x, y, z]" : text;
}

std::string range_cell(const KeySpec& key) {
  if (!key.has_range() || key.type == kDirection || key.type == kPosition) return "";
  return concat({number_text(key.min), " … ", number_text(key.max)});
}

char lower(char c) {
  return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
}

/// Number of edits (insert, delete, replace, swap two neighbours) that turn a into b, ignoring case, with at
/// most one edit per letter (optimal string alignment distance).
int edit_distance(std::string_view a, std::string_view b) {
  std::vector<int> before(b.size() + 1), row(b.size() + 1), next(b.size() + 1);
  std::iota(row.begin(), row.end(), 0);
  for (std::size_t i = 0; i < a.size(); ++i) {
    next[0] = static_cast<int>(i) + 1;
    for (std::size_t j = 0; j < b.size(); ++j) {
      const bool equal = lower(a[i]) == lower(b[j]);
      next[j + 1] = std::min({row[j] + (equal ? 0 : 1), row[j + 1] + 1, next[j] + 1});
      const bool swapped = i > 0 && j > 0 && lower(a[i]) == lower(b[j - 1]) && lower(a[i - 1]) == lower(b[j]);
      if (swapped) next[j + 1] = std::min(next[j + 1], before[j - 1] + 1);
    }
    std::swap(before, row);
    std::swap(row, next);
  }
  return row.back();
}

/// Wraps a paragraph at 120 columns, the line width of the manual.
std::string in_lines(std::string_view text) {
  constexpr std::size_t kWidth = 120;
  std::string lines;
  std::size_t column = 0;
  while (!text.empty()) {
    const std::string_view word = text.substr(0, text.find(' '));
    text.remove_prefix(std::min(word.size() + 1, text.size()));
    if (column > 0) {
      const bool fits = column + 1 + word.size() <= kWidth;
      lines += fits ? ' ' : '\n';
      column = fits ? column + 1 : 0;
    }
    lines += word;
    column += word.size();
  }
  return lines;
}

}  // namespace

std::string table_markdown(const TableSpec& table) {
  std::string text = concat({"### ", table.heading, "\n\n", in_lines(table.about), "\n\n"});
  text += "| key | value | default | unit | range | meaning |\n|---|---|---|---|---|---|\n";
  for (const KeySpec& key : table.keys) {
    text += concat({"| `", key.name, "` | ", value_cell(key), " | ", default_cell(key), " | ", key.unit,
                    " | ", range_cell(key), " | ", key.meaning, " |\n"});
  }
  return text;
}

const KeySpec* TableSpec::find(std::string_view key) const {
  const auto found = std::find_if(keys.begin(), keys.end(), [&](const KeySpec& k) { return k.name == key; });
  return found == keys.end() ? nullptr : &*found;
}

std::vector<std::string_view> direction_names() {
  std::vector<std::string_view> names;
  for (const auto& [name, direction] : kPatientDirections) names.push_back(name);
  return names;
}

KeySpec structures_key(std::string_view meaning) {
  return {.name = "structures", .type = KeyType::kLabels, .min = 1, .max = 65535, .meaning = meaning};
}

std::string number_text(double value) {
  // plain decimal notation for numbers of ordinary size
  const double size = std::abs(value);
  const bool plain = size == 0 || (size >= 1e-6 && size < 1e16);
  std::array<char, 64> digits{};
  const auto format = plain ? std::chars_format::fixed : std::chars_format::general;
  const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), value, format).ptr;
  return {digits.data(), end};
}

std::string range_text(const KeySpec& key) {
  if (!key.choices.empty()) {
    std::string text;
    for (std::size_t i = 0; i < key.choices.size(); ++i) {
      const bool last = i + 1 == key.choices.size();
      text += concat({i == 0 ? "" : last ? " or " : ", ", "\"", key.choices[i], "\""});
    }
    return key.type == kDirection ? text + ", or [x, y, z]" : text;
  }
  if (!key.has_range()) return "";
  return concat({number_text(key.min), " ... ", number_text(key.max), key.unit.empty() ? "" : " ", key.unit});
}

std::string_view type_text(KeyType type) {
  switch (type) {
    case kText:
      return "a text";
    case kFile:
      return "a path";
    case kChoice:
      return "a choice";
    case kFlag:
      return "true or false";
    case kNumber:
      return "a number";
    case kInteger:
      return "a whole number";
    case kColour:
      return "a colour";
    case kLabels:
      return "a list of label names and numbers";
    case kNames:
      return "a list of names";
    case kInterval:
      return "two numbers";
    case kPoint:
      return "a point [x, y, z]";
    case kPosition:
      return "a text or a point [x, y, z]";
    case kPoints:
      return "a list of points";
    case kTerms:
      return "a list of pairs [fraction, time]";
    case kDirection:
      return "a direction";
    case kTable:
      return "a table";
    case kTables:
      return "tables";
  }
  return "";
}

std::string remedy_text(const KeySpec& key) {
  std::string text = std::string(key.name) + " takes ";
  const std::string range = range_text(key);
  if (key.type == KeyType::kChoice || key.type == KeyType::kDirection) {
    text += range;
  } else {
    text += std::string(type_text(key.type)) + (range.empty() ? "" : ", " + range);
  }
  if (key.type == KeyType::kTable) text = "write [" + std::string(key.name) + "] on a line of its own";
  if (key.type == KeyType::kTables)
    text = "write [[" + std::string(key.heading_prefix) + std::string(key.name) + "]] on a line of its own";
  return key.default_text.empty() ? text : text + "; default " + std::string(key.default_text);
}

std::optional<Fault> range_error(const KeySpec& key, double value) {
  const std::string name(key.name);
  if (!std::isfinite(value)) return Fault{name + " is not a finite number", remedy_text(key)};
  if (key.has_range() && (value < key.min || value > key.max))
    return Fault{name + " = " + number_text(value) + " is outside " + range_text(key), remedy_text(key)};
  return std::nullopt;
}

std::string_view closest_match(std::string_view text, const std::vector<std::string_view>& candidates) {
  // a mistyped name is short; this bounds the cost of comparing longer texts
  constexpr std::size_t kMaxCompared = 100;
  text = text.substr(0, kMaxCompared);
  std::string_view best;
  int smallest = std::max(1, static_cast<int>(text.size()) / 3) + 1;
  for (const auto candidate : candidates) {
    // the difference in length is a lower bound of the distance
    const auto length = static_cast<int>(std::min(candidate.size(), kMaxCompared));
    if (std::abs(length - static_cast<int>(text.size())) >= smallest) continue;
    const int edits = edit_distance(text, candidate.substr(0, kMaxCompared));
    if (edits >= smallest) continue;
    best = candidate;
    smallest = edits;
  }
  return best;
}

std::string did_you_mean(std::string_view text, const std::vector<std::string_view>& candidates,
                         std::string_view quote) {
  const std::string_view candidate = closest_match(text, candidates);
  return candidate.empty() ? "" : concat({"did you mean ", quote, candidate, quote, "? "});
}

}  // namespace palpate
