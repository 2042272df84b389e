#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/scene/scene.h"
#include "scene/keys.h"
#include "scene/toml_document.h"

namespace palpate {

/// Collects the errors of a text and keeps the first by line. Missing keys are reported only if there is no
/// other error, because a mistyped key is often the reason why another one seems to be missing.
class Problems {
 public:
  explicit Problems(std::string source) : source_(std::move(source)) {}

  void add(int line, std::string what, std::string remedy);
  void add_missing(int line, std::string what, std::string remedy);
  /// Adds the errors of a table that shares key names with another; the heading is added to each for
  /// disambiguation.
  void add_from(const Problems& part, std::string_view heading);
  bool any() const { return wrong_.has_value() || missing_.has_value(); }
  /// First error; requires any().
  const Error& first() const { return wrong_ ? wrong_->error : missing_->error; }

 private:
  struct Problem {
    int line;
    Error error;
  };
  void retain_earliest(std::optional<Problem>& first, int line, std::string what, std::string remedy) const;

  std::string source_;
  std::optional<Problem> wrong_, missing_;
};

/// Reads one TOML table against its declaration. An unknown key, a wrong type and a value out of range are
/// added to Problems; an absent or invalid key reads as empty. Asking for an undeclared key, or for one as
/// another type, is a bug.
class TableReader {
 public:
  struct Labels {
    std::vector<LabelReference> references;
    std::vector<int> lines;  ///< Line of each
  };

  /// @param table  null: the table is absent from the text, and so is every key
  TableReader(const TomlTable* table, const TableSpec& spec, Problems& problems);

  std::optional<std::string> text(std::string_view key) const;  ///< Text or path (kText, kFile)
  std::optional<std::string> choice(std::string_view key) const;
  std::optional<bool> flag(std::string_view key) const;
  std::optional<double> number(std::string_view key) const;
  std::optional<std::int64_t> integer(std::string_view key) const;
  std::optional<Rgb> colour(std::string_view key) const;
  std::optional<Labels> labels(std::string_view key) const;
  std::optional<std::vector<std::string>> names(std::string_view key) const;
  std::optional<std::array<double, 2>> interval(std::string_view key) const;
  std::optional<Eigen::Vector3d> point(std::string_view key) const;
  std::optional<std::vector<Eigen::Vector3d>> points(std::string_view key) const;
  /// Terms as written; finite.
  std::optional<std::vector<std::array<double, 2>>> terms(std::string_view key) const;
  /// Name of a structure, or a point.
  std::optional<std::variant<std::string, Eigen::Vector3d>> position(std::string_view key) const;
  /// One of the choices, or a vector.
  std::optional<std::variant<std::string, Eigen::Vector3d>> direction(std::string_view key) const;
  const TomlTable* table(std::string_view key) const;  ///< Nested table; null: absent
  std::vector<const TomlTable*> tables(std::string_view key) const;

  bool has(std::string_view key) const { return find(key, nullptr) != nullptr; }
  /// Line of a key, or of the table if the key is absent.
  int line(std::string_view key) const;
  int line() const { return table_ ? table_->line : 1; }

 private:
  const TomlValue* find(std::string_view key, const KeySpec** spec) const;
  const TomlValue* find(std::string_view key, KeyType type, const KeySpec** spec) const;
  void wrong_type(const KeySpec& key, const TomlValue& value) const;
  std::optional<std::string> non_empty_text(const KeySpec& key, const TomlValue& value) const;
  std::optional<double> number_in_range(const KeySpec& key, const TomlValue& value, int line) const;
  std::optional<Eigen::Vector3d> vector3(const KeySpec& key, const TomlValue& value, int line) const;

  const TomlTable* table_;
  const TableSpec& spec_;
  Problems& problems_;
};

/// Vector of a direction of kPatientDirections; the name has to be one of them.
Vector<Patient> direction_named(std::string_view name);

/// The first `max_count` tables of an array of tables; adds an error if there are more.
std::vector<const TomlTable*> limited_tables(const TableReader& top, std::string_view key,
                                             std::size_t max_count, std::string_view remedy,
                                             Problems& problems);
/// Reads the required key `name`.
/// @param heading  description of the table in errors: "a [[region]]"
std::string required_name(const TableReader& reader, std::string_view heading, Problems& problems);
/// Reads the key `structures`.
/// @param needed  whether it is required
std::vector<LabelReference> structures_of(const TableReader& reader, std::string_view heading, bool needed,
                                          Problems& problems);

}  // namespace palpate
