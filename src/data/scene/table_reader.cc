#include "scene/table_reader.h"
#include "palpate/scene/script.h"

#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

/// Type of a value, for errors.
std::string found_text(const TomlValue& value) {
  constexpr std::array<const char*, 7> kKinds{"true or false", "a whole number", "a number", "a text",
                                              "a date",        "a list",         "a table"};
  return kKinds[value.content.index()];
}

std::optional<double> as_number(const TomlValue& value) {
  if (const auto* number = value.as<double>()) return *number;
  if (const auto* whole = value.as<std::int64_t>()) return static_cast<double>(*whole);
  return std::nullopt;
}

int hex_digit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

}  // namespace

void Problems::retain_earliest(std::optional<Problem>& first, int line, std::string what,
                               std::string remedy) const {
  if (first && line >= first->line) return;
  first = {line, Error{ErrorKind::kBadInput, std::move(what), source_ + ":" + std::to_string(line),
                       std::move(remedy)}};
}

void Problems::add(int line, std::string what, std::string remedy) {
  retain_earliest(wrong_, line, std::move(what), std::move(remedy));
}

void Problems::add_missing(int line, std::string what, std::string remedy) {
  retain_earliest(missing_, line, std::move(what), std::move(remedy));
}

void Problems::add_from(const Problems& part, std::string_view heading) {
  const auto reported = [&](const Problem& problem) {
    const std::string& what = problem.error.what;
    return what.find(heading) != std::string::npos ? what : std::string(heading) + ": " + what;
  };
  if (part.wrong_) add(part.wrong_->line, reported(*part.wrong_), part.wrong_->error.remedy);
  if (part.missing_) add_missing(part.missing_->line, reported(*part.missing_), part.missing_->error.remedy);
}

TableReader::TableReader(const TomlTable* table, const TableSpec& spec, Problems& problems)
    : table_(table), spec_(spec), problems_(problems) {
  if (!table_) return;
  // entries are in the order of their lines, so this finds the first unknown key of the file
  const auto unknown = std::find_if(table_->entries.begin(), table_->entries.end(),
                                    [&](const TomlEntry& entry) { return !spec.find(entry.key); });
  if (unknown == table_->entries.end()) return;
  std::vector<std::string_view> known;
  std::string list;
  for (const KeySpec& key : spec.keys) {
    known.push_back(key.name);
    list += (list.empty() ? "" : ", ") + std::string(key.name);
  }
  problems_.add(unknown->value.line, "unknown key \"" + unknown->key + "\" in " + std::string(spec.heading),
                did_you_mean(unknown->key, known) + "the keys here are " + list);
}

const TomlValue* TableReader::find(std::string_view key, const KeySpec** spec) const {
  const KeySpec* declared = spec_.find(key);
  PALPATE_CHECK(declared != nullptr);
  if (spec) *spec = declared;
  return table_ ? table_->find(key) : nullptr;
}

const TomlValue* TableReader::find(std::string_view key, KeyType type, const KeySpec** spec) const {
  const TomlValue* value = find(key, spec);
  PALPATE_CHECK((*spec)->type == type);
  return value;
}

int TableReader::line(std::string_view key) const {
  const TomlValue* value = find(key, nullptr);
  return value ? value->line : line();
}

void TableReader::wrong_type(const KeySpec& key, const TomlValue& value) const {
  problems_.add(value.line, std::string(key.name) + " is " + found_text(value), remedy_text(key));
}

std::optional<std::string> TableReader::text(std::string_view key) const {
  const KeySpec* spec = nullptr;
  const TomlValue* value = find(key, &spec);
  PALPATE_CHECK(spec->type == KeyType::kText || spec->type == KeyType::kFile);
  if (!value) return std::nullopt;
  const auto* text = value->as<std::string>();
  if (!text) {
    wrong_type(*spec, *value);
    return std::nullopt;
  }
  return non_empty_text(*spec, *value);
}

// a NUL would truncate a file name, and an empty string names nothing
std::optional<std::string> TableReader::non_empty_text(const KeySpec& key, const TomlValue& value) const {
  const auto& text = *value.as<std::string>();
  if (!text.empty() && text.find('\0') == std::string::npos) return text;
  problems_.add(value.line, std::string(key.name) + (text.empty() ? " is empty" : " holds a zero byte"),
                key.default_text.empty() ? "give it a text" : remedy_text(key));
  return std::nullopt;
}

std::optional<std::string> TableReader::choice(std::string_view key) const {
  const KeySpec* spec = nullptr;
  const TomlValue* value = find(key, KeyType::kChoice, &spec);
  if (!value) return std::nullopt;
  const auto* text = value->as<std::string>();
  if (!text) {
    wrong_type(*spec, *value);
    return std::nullopt;
  }
  if (std::find(spec->choices.begin(), spec->choices.end(), *text) == spec->choices.end()) {
    problems_.add(value->line, "unknown " + std::string(key) + " \"" + *text + "\"",
                  did_you_mean(*text, spec->choices, "\"") + remedy_text(*spec));
    return std::nullopt;
  }
  return *text;
}

std::optional<bool> TableReader::flag(std::string_view key) const {
  const KeySpec* spec = nullptr;
  const TomlValue* value = find(key, KeyType::kFlag, &spec);
  if (!value) return std::nullopt;
  if (const auto* flag = value->as<bool>()) return *flag;
  wrong_type(*spec, *value);
  return std::nullopt;
}

std::optional<double> TableReader::number_in_range(const KeySpec& key, const TomlValue& value,
                                                   int line) const {
  const std::string name(key.name);
  const auto number = as_number(value);
  if (!number) {
    problems_.add(line, name + " holds " + found_text(value) + " instead of a number", remedy_text(key));
    return std::nullopt;
  }
  if (auto fault = range_error(key, *number)) {
    problems_.add(line, std::move(fault->what), std::move(fault->remedy));
    return std::nullopt;
  }
  return number;
}

std::optional<double> TableReader::number(std::string_view key) const {
  const KeySpec* spec = nullptr;
  const TomlValue* value = find(key, KeyType::kNumber, &spec);
  if (!value) return std::nullopt;
  if (!as_number(*value)) {
    wrong_type(*spec, *value);
    return std::nullopt;
  }
  return number_in_range(*spec, *value, value->line);
}

std::optional<std::int64_t> TableReader::integer(std::string_view key) const {
  const KeySpec* spec = nullptr;
  const TomlValue* value = find(key, KeyType::kInteger, &spec);
  if (!value) return std::nullopt;
  const auto* whole = value->as<std::int64_t>();
  if (!whole) {
    wrong_type(*spec, *value);
    return std::nullopt;
  }
  return number_in_range(*spec, *value, value->line) ? std::optional(*whole) : std::nullopt;
}

std::optional<Rgb> TableReader::colour(std::string_view key) const {
  const KeySpec* spec = nullptr;
  const TomlValue* value = find(key, KeyType::kColour, &spec);
  if (!value) return std::nullopt;
  const auto* text = value->as<std::string>();
  if (!text) {
    wrong_type(*spec, *value);
    return std::nullopt;
  }
  std::array<int, 6> digits{};
  bool valid = text->size() == 7 && text->front() == '#';
  for (std::size_t i = 0; valid && i < digits.size(); ++i) {
    digits[i] = hex_digit((*text)[i + 1]);
    valid = digits[i] >= 0;
  }
  if (!valid) {
    problems_.add(value->line, std::string(key) + " = \"" + *text + "\" is not a colour",
                  "write red, green and blue as hexadecimal digits, e.g. \"#e6e696\"");
    return std::nullopt;
  }
  const auto channel = [&](std::size_t i) {
    return static_cast<std::uint8_t>(16 * digits[2 * i] + digits[2 * i + 1]);
  };
  return Rgb{channel(0), channel(1), channel(2)};
}

std::optional<TableReader::Labels> TableReader::labels(std::string_view key) const {
  const KeySpec* spec = nullptr;
  const TomlValue* value = find(key, KeyType::kLabels, &spec);
  if (!value) return std::nullopt;
  const auto* items = value->as<TomlArray>();
  if (!items) {
    wrong_type(*spec, *value);
    return std::nullopt;
  }
  if (items->empty()) {
    problems_.add(value->line, std::string(key) + " is an empty list", "name at least one structure");
    return std::nullopt;
  }
  Labels labels;
  for (const TomlValue& item : *items) {
    if (const auto* name = item.as<std::string>()) {
      labels.references.emplace_back(*name);
    } else if (const auto* number = item.as<std::int64_t>()) {
      if (!number_in_range(*spec, item, item.line)) return std::nullopt;
      labels.references.emplace_back(static_cast<int>(*number));
    } else {
      problems_.add(item.line, std::string(key) + " holds " + found_text(item), remedy_text(*spec));
      return std::nullopt;
    }
    labels.lines.push_back(item.line);
  }
  return labels;
}

std::optional<std::vector<std::string>> TableReader::names(std::string_view key) const {
  const KeySpec* spec = nullptr;
  const TomlValue* value = find(key, KeyType::kNames, &spec);
  if (!value) return std::nullopt;
  const auto* items = value->as<TomlArray>();
  if (!items) {
    wrong_type(*spec, *value);
    return std::nullopt;
  }
  std::vector<std::string> names;
  for (const TomlValue& item : *items) {
    const auto* name = item.as<std::string>();
    if (!name) {
      problems_.add(item.line, std::string(key) + " holds " + found_text(item), remedy_text(*spec));
      return std::nullopt;
    }
    names.push_back(*name);
  }
  return names;
}

std::optional<std::array<double, 2>> TableReader::interval(std::string_view key) const {
  const KeySpec* spec = nullptr;
  const TomlValue* value = find(key, KeyType::kInterval, &spec);
  if (!value) return std::nullopt;
  const auto* items = value->as<TomlArray>();
  if (!items || items->size() != 2) {
    problems_.add(value->line, std::string(key) + " is not a list of two numbers", remedy_text(*spec));
    return std::nullopt;
  }
  const auto low = number_in_range(*spec, items->front(), items->front().line);
  const auto high = number_in_range(*spec, items->back(), items->back().line);
  if (!low || !high) return std::nullopt;
  if (*low >= *high) {
    problems_.add(value->line,
                  std::string(key) + " begins at " + number_text(*low) + ", which is not below its end " +
                      number_text(*high),
                  "write the lower number first");
    return std::nullopt;
  }
  return std::array{*low, *high};
}

std::optional<Eigen::Vector3d> TableReader::vector3(const KeySpec& key, const TomlValue& value,
                                                    int line) const {
  const auto* items = value.as<TomlArray>();
  if (!items || items->size() != 3) {
    problems_.add(line, std::string(key.name) + " has an entry that is not three numbers [x, y, z]",
                  remedy_text(key));
    return std::nullopt;
  }
  Eigen::Vector3d vector;
  for (std::size_t i = 0; i < 3; ++i) {
    const auto number = number_in_range(key, (*items)[i], (*items)[i].line);
    if (!number) return std::nullopt;
    vector[static_cast<int>(i)] = *number;
  }
  return vector;
}

std::optional<Eigen::Vector3d> TableReader::point(std::string_view key) const {
  const KeySpec* spec = nullptr;
  const TomlValue* value = find(key, KeyType::kPoint, &spec);
  if (!value) return std::nullopt;
  if (!value->as<TomlArray>()) {
    wrong_type(*spec, *value);
    return std::nullopt;
  }
  return vector3(*spec, *value, value->line);
}

std::optional<std::vector<Eigen::Vector3d>> TableReader::points(std::string_view key) const {
  const KeySpec* spec = nullptr;
  const TomlValue* value = find(key, KeyType::kPoints, &spec);
  if (!value) return std::nullopt;
  const auto* items = value->as<TomlArray>();
  if (!items) {
    wrong_type(*spec, *value);
    return std::nullopt;
  }
  std::vector<Eigen::Vector3d> points;
  for (const TomlValue& item : *items) {
    const auto point = vector3(*spec, item, item.line);
    if (!point) return std::nullopt;
    points.push_back(*point);
  }
  return points;
}

std::optional<std::vector<std::array<double, 2>>> TableReader::terms(std::string_view key) const {
  const KeySpec* spec = nullptr;
  const TomlValue* value = find(key, KeyType::kTerms, &spec);
  if (!value) return std::nullopt;
  const auto* items = value->as<TomlArray>();
  if (!items) {
    wrong_type(*spec, *value);
    return std::nullopt;
  }
  KeySpec part = *spec;
  part.min = part.max = 0;
  std::vector<std::array<double, 2>> terms;
  for (const TomlValue& item : *items) {
    const auto* pair = item.as<TomlArray>();
    if (!pair || pair->size() != 2) {
      problems_.add(item.line, std::string(key) + " has an entry that is not two numbers [fraction, time]",
                    remedy_text(*spec));
      return std::nullopt;
    }
    const auto first = number_in_range(part, pair->front(), pair->front().line);
    const auto second = number_in_range(*spec, pair->back(), pair->back().line);
    if (!first || !second) return std::nullopt;
    terms.push_back({*first, *second});
  }
  return terms;
}

std::optional<std::variant<std::string, Eigen::Vector3d>> TableReader::position(std::string_view key) const {
  const KeySpec* spec = nullptr;
  const TomlValue* value = find(key, KeyType::kPosition, &spec);
  if (!value) return std::nullopt;
  if (value->as<std::string>()) {
    auto text = non_empty_text(*spec, *value);
    if (!text) return std::nullopt;
    return *std::move(text);
  }
  if (!value->as<TomlArray>()) {
    wrong_type(*spec, *value);
    return std::nullopt;
  }
  const auto point = vector3(*spec, *value, value->line);
  if (!point) return std::nullopt;
  return *point;
}

std::optional<std::variant<std::string, Eigen::Vector3d>> TableReader::direction(std::string_view key) const {
  const KeySpec* spec = nullptr;
  const TomlValue* value = find(key, KeyType::kDirection, &spec);
  if (!value) return std::nullopt;
  if (const auto* name = value->as<std::string>()) {
    if (std::find(spec->choices.begin(), spec->choices.end(), *name) != spec->choices.end()) return *name;
    problems_.add(value->line, "unknown " + std::string(key) + " \"" + *name + "\"",
                  did_you_mean(*name, spec->choices, "\"") + remedy_text(*spec));
    return std::nullopt;
  }
  if (!value->as<TomlArray>()) {
    wrong_type(*spec, *value);
    return std::nullopt;
  }
  const auto vector = vector3(*spec, *value, value->line);
  if (!vector) return std::nullopt;
  // a shorter vector is noise, and normalising it, or an infinite one, would give NaN
  if (vector->norm() < 1e-6 || !std::isfinite(vector->norm())) {
    problems_.add(value->line, std::string(key) + " has no direction", remedy_text(*spec));
    return std::nullopt;
  }
  return *vector;
}

const TomlTable* TableReader::table(std::string_view key) const {
  const KeySpec* spec = nullptr;
  const TomlValue* value = find(key, KeyType::kTable, &spec);
  if (!value) return nullptr;
  const auto* table = value->as<TomlTable>();
  if (!table) wrong_type(*spec, *value);
  return table;
}

std::vector<const TomlTable*> TableReader::tables(std::string_view key) const {
  const KeySpec* spec = nullptr;
  const TomlValue* value = find(key, KeyType::kTables, &spec);
  if (!value) return {};
  const auto* items = value->as<TomlArray>();
  if (!items) {
    wrong_type(*spec, *value);
    return {};
  }
  std::vector<const TomlTable*> tables;
  for (const TomlValue& item : *items) {
    if (const auto* table = item.as<TomlTable>()) {
      tables.push_back(table);
    } else {
      wrong_type(*spec, item);
    }
  }
  return tables;
}

Vector<Patient> direction_named(std::string_view name) {
  for (const auto& [known, direction] : kPatientDirections)
    if (known == name) return {direction[0], direction[1], direction[2]};
  PALPATE_CHECK(false);
  return {};
}

std::vector<const TomlTable*> limited_tables(const TableReader& top, std::string_view key,
                                             std::size_t max_count, std::string_view remedy,
                                             Problems& problems) {
  auto tables = top.tables(key);
  if (tables.size() > max_count) {
    problems.add(tables[max_count]->line,
                 "more than " + std::to_string(max_count) + " [[" + std::string(key) + "]]",
                 std::string(remedy));
    tables.resize(max_count);
  }
  return tables;
}

std::string required_name(const TableReader& reader, std::string_view heading, Problems& problems) {
  auto name = reader.text("name");
  if (!name && !reader.has("name"))
    problems.add_missing(reader.line(), std::string(heading) + " without a name", "add name = \"...\"");
  return name.value_or("");
}

std::vector<LabelReference> structures_of(const TableReader& reader, std::string_view heading, bool needed,
                                          Problems& problems) {
  auto labels = reader.labels("structures");
  if (needed && !reader.has("structures"))
    problems.add_missing(reader.line(), std::string(heading) + " without structures",
                         "add structures = [\"...\"], by name or number");
  return labels ? std::move(labels->references) : std::vector<LabelReference>();
}

}  // namespace palpate
