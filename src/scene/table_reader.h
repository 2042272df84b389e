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

/// Collects what is wrong with a text and keeps the problem that comes first in it. What is missing counts
/// only when nothing that stands there is wrong: a mistyped key is often why something seems to be missing.
class Problems {
 public:
  explicit Problems(std::string source) : source_(std::move(source)) {}

  void add(int line, std::string what, std::string remedy);
  void add_missing(int line, std::string what, std::string remedy);
  /// Those of a part that has keys of another one's names: each tells its table.
  void add_from(const Problems& part, std::string_view heading);
  bool any() const { return wrong_.has_value() || missing_.has_value(); }
  /// The first one; only when any().
  const Error& first() const { return wrong_ ? wrong_->error : missing_->error; }

 private:
  struct Problem {
    int line;
    Error error;
  };
  void keep_first(std::optional<Problem>& first, int line, std::string what, std::string remedy) const;

  std::string source_;
  std::optional<Problem> wrong_, missing_;
};

/// Reads one TOML table against its declaration: an unknown key, a wrong type and a value out of range
/// become problems; a key that is absent or wrong reads as nothing. Asking for a key that is not declared,
/// or as another type, is a bug.
class TableReader {
 public:
  struct Labels {
    std::vector<LabelReference> references;
    std::vector<int> lines;  ///< of each
  };

  /// @param table  null where the text does not have it: every key is absent then
  TableReader(const TomlTable* table, const TableSpec& spec, Problems& problems);

  std::optional<std::string> text(std::string_view key) const;  ///< kText, kFile
  std::optional<std::string> choice(std::string_view key) const;
  std::optional<bool> flag(std::string_view key) const;
  std::optional<double> number(std::string_view key) const;
  std::optional<std::int64_t> whole(std::string_view key) const;
  std::optional<Rgb> colour(std::string_view key) const;
  std::optional<Labels> labels(std::string_view key) const;
  std::optional<std::vector<std::string>> names(std::string_view key) const;
  std::optional<std::array<double, 2>> interval(std::string_view key) const;
  std::optional<Eigen::Vector3d> point(std::string_view key) const;
  std::optional<std::vector<Eigen::Vector3d>> points(std::string_view key) const;
  /// Parts as they stand there, finite.
  std::optional<std::vector<std::array<double, 2>>> terms(std::string_view key) const;
  /// A structure's name, or a point.
  std::optional<std::variant<std::string, Eigen::Vector3d>> place(std::string_view key) const;
  /// A name from the choices, or a vector.
  std::optional<std::variant<std::string, Eigen::Vector3d>> direction(std::string_view key) const;
  const TomlTable* table(std::string_view key) const;  ///< null when absent
  std::vector<const TomlTable*> tables(std::string_view key) const;

  bool has(std::string_view key) const { return find(key, nullptr) != nullptr; }
  /// Line of a key, or of the table where it is absent.
  int line(std::string_view key) const;
  int line() const { return table_ ? table_->line : 1; }

 private:
  const TomlValue* find(std::string_view key, const KeySpec** spec) const;
  const TomlValue* find(std::string_view key, KeyType type, const KeySpec** spec) const;
  void wrong_type(const KeySpec& key, const TomlValue& value) const;
  std::optional<std::string> whole_text(const KeySpec& key, const TomlValue& value) const;
  std::optional<double> number_in_range(const KeySpec& key, const TomlValue& value, int line) const;
  std::optional<Eigen::Vector3d> vector3(const KeySpec& key, const TomlValue& value, int line) const;

  const TomlTable* table_;
  const TableSpec& spec_;
  Problems& problems_;
};

/// A direction of kPatientDirections by its name, which is one of them.
Vector<Patient> direction_named(std::string_view name);

/// Tables of a kind; the first `most` of them, and a problem, where there are more.
std::vector<const TomlTable*> few_tables(const TableReader& top, std::string_view key, std::size_t most,
                                         std::string_view remedy, Problems& problems);
/// The key `name`, which has to be there. @param heading  what the table is, for errors: "a [[region]]"
std::string name_of_part(const TableReader& reader, std::string_view heading, Problems& problems);
/// The key `structures`. @param needed  it has to be there
std::vector<LabelReference> structures_of(const TableReader& reader, std::string_view heading, bool needed,
                                          Problems& problems);

}  // namespace palpate
