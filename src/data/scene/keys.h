#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

/// The keys of scenes and scripts, declared once: the parser checks against these tables, and `palpate scene
/// keys` prints them.
namespace palpate {

enum class KeyType {
  kText,       ///< Non-empty string
  kFile,       ///< Path
  kChoice,     ///< One of `choices`
  kFlag,       ///< True or false
  kNumber,     ///< Finite number, min ... max
  kInteger,    ///< Integer, min ... max
  kColour,     ///< "#rrggbb"
  kLabels,     ///< List of label numbers and names
  kNames,      ///< List of names
  kInterval,   ///< [low, high], low < high, each min ... max
  kPoint,      ///< [x, y, z], each coordinate min ... max
  kPosition,   ///< Non-empty string, or [x, y, z], each coordinate min ... max
  kPoints,     ///< List of [x, y, z], each coordinate min ... max
  kTerms,      ///< List of [part, time], each time min ... max
  kDirection,  ///< One of `choices`, or a non-zero [x, y, z]
  kTable,      ///< [name]
  kTables,     ///< [[name]], repeatable
};

struct KeySpec {
  std::string_view name;
  KeyType type;
  std::string_view default_text = {};  ///< As written in TOML; empty: none
  std::string_view unit = {};          ///< Empty: none
  double min = 0, max = 0;             ///< Range of numbers; both 0: unlimited
  std::vector<std::string_view> choices = {};
  std::string_view meaning = {};
  std::string_view heading_prefix = {};  ///< Prefix of a nested table's name in its heading, "tool."

  bool has_range() const { return min != 0 || max != 0; }
};

struct TableSpec {
  std::string_view heading;  ///< "[data]", "[[tissue]]", "top level"
  std::string_view about;
  std::vector<KeySpec> keys;

  const KeySpec* find(std::string_view key) const;
};

struct SceneKeys {
  TableSpec top, data, tissue, preparation, force, deformation, density, tool, capsule, workspace, limits,
      distances, no_go;
  TableSpec second_tool = {}, second_capsule = {};  ///< With the same keys as tool and capsule
};
const SceneKeys& scene_key_tables();

struct ScriptKeys {
  TableSpec top;
  /// Actions of a [[step]], in the order of ScriptStep; the first key of each names the action.
  std::vector<TableSpec> actions;
};
const ScriptKeys& script_key_tables();

/// Names of the elements of a table such as kTissueLaws, as the choices of a key.
template <class Entries>
std::vector<std::string_view> names_of(const Entries& entries) {
  std::vector<std::string_view> names;
  for (const auto& entry : entries) names.push_back(entry.name);
  return names;
}
/// Names of kPatientDirections.
std::vector<std::string_view> direction_names();
/// Declares the key `structures`: labels by name or number.
KeySpec structures_key(std::string_view meaning);

/// A table's keys with types and meanings as Markdown, for the documentation.
std::string table_markdown(const TableSpec& table);

/// Range of a key's values: "0.001 ... 20 N/mm", "\"direct\" or \"fourier\"", "" if unrestricted.
std::string range_text(const KeySpec& key);
/// Name of a type: "a number", "a list of label numbers and names", ...
std::string_view type_text(KeyType type);
/// Accepted values of a key, as the remedy of an error: "stiffness takes a number, 0.001 ... 20 N/mm; default
/// 1".
std::string remedy_text(const KeySpec& key);

/// An error and its remedy.
struct Fault {
  std::string what, remedy;
};
/// Checks a number against the key's range. Empty: valid.
std::optional<Fault> range_error(const KeySpec& key, double value);

/// Shortest decimal that parses to the same number.
std::string number_text(double value);

/// The candidate of which `text` is most likely a misspelling: at most a third of its letters edited,
/// ignoring case. Empty: none is that close.
std::string_view closest_match(std::string_view text, const std::vector<std::string_view>& candidates);
/// "did you mean stiffness? " with the result of closest_match() between `quote`s; "" if there is none.
std::string did_you_mean(std::string_view text, const std::vector<std::string_view>& candidates,
                         std::string_view quote = "");

}  // namespace palpate
