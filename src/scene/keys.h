#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

/// The keys of a scene and of a script, declared once: the parser checks against these tables, and the
/// tables of docs/reference/scene-keys.md and docs/reference/script-keys.md are printed from them.
namespace palpate {

enum class KeyType {
  kText,       ///< not empty
  kFile,       ///< a path
  kChoice,     ///< one of `choices`
  kFlag,       ///< true or false
  kNumber,     ///< finite, min ... max
  kWhole,      ///< whole number, min ... max
  kColour,     ///< "#rrggbb"
  kLabels,     ///< list of label numbers and names
  kNames,      ///< list of names
  kInterval,   ///< [low, high], low < high, each min ... max
  kPoint,      ///< [x, y, z], each coordinate min ... max
  kPlace,      ///< a text that is not empty, or [x, y, z], each coordinate min ... max
  kPoints,     ///< list of [x, y, z], each coordinate min ... max
  kTerms,      ///< list of [part, time], each time min ... max
  kDirection,  ///< one of `choices`, or [x, y, z] that is not zero
  kTable,      ///< [name]
  kTables,     ///< [[name]], any number of times
};

struct KeySpec {
  std::string_view name;
  KeyType type;
  std::string_view default_text = {};  ///< as written in TOML; empty: none
  std::string_view unit = {};          ///< empty: none
  double min = 0, max = 0;             ///< of numbers; both 0: no range
  std::vector<std::string_view> choices = {};
  std::string_view meaning = {};
  std::string_view under = {};  ///< of a table in a table: what goes before its name in a heading, "tool."

  bool has_range() const { return min != 0 || max != 0; }
};

struct TableSpec {
  std::string_view heading;  ///< "[data]", "[[tissue]]", "top level"
  std::string_view about;
  std::vector<KeySpec> keys;

  const KeySpec* find(std::string_view key) const;
};

struct SceneKeys {
  TableSpec top, data, tissue, preparation, force, yielding, tool, capsule, workspace, limits, distances,
      no_go;
  TableSpec second_tool = {}, second_capsule = {};  ///< with the keys of the first's
};
const SceneKeys& scene_key_tables();

struct ScriptKeys {
  TableSpec top;
  std::vector<TableSpec> actions;  ///< of a [[step]], in the order of ScriptStep; first key: the action
};
const ScriptKeys& script_key_tables();

/// The names of kPatientDirections.
std::vector<std::string_view> direction_names();
/// The key `structures`: labels by name or number.
KeySpec structures_key(std::string_view meaning);

/// A table's keys with what they take and mean, for the documents.
std::string table_markdown(const TableSpec& table);

/// "0.001 ... 20 N/mm", "\"direct\" or \"fourier\"", "" where everything goes.
std::string range_text(const KeySpec& key);
/// "a number", "a list of label numbers and names", ...
std::string_view type_text(KeyType type);
/// What a key takes, as a remedy: "stiffness takes a number, 0.001 ... 20 N/mm; default 1".
std::string remedy_text(const KeySpec& key);

/// What is wrong, and how to mend it.
struct Fault {
  std::string what, remedy;
};
/// Of a number for a key; nothing when it fits.
std::optional<Fault> number_fault(const KeySpec& key, double value);

/// The shortest decimal that reads back as the same number.
std::string number_text(double value);

/// The candidate that `text` is most likely a slip of: at most a third of its letters edited, capitals
/// aside. Empty where none is that near.
std::string_view nearest(std::string_view text, const std::vector<std::string_view>& candidates);
/// "did you mean stiffness? " for what nearest() finds, put between `quote`s; else "".
std::string did_you_mean(std::string_view text, const std::vector<std::string_view>& candidates,
                         std::string_view quote = "");

}  // namespace palpate
