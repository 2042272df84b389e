#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "palpate/base/result.h"

/// A TOML text as a plain tree in which everything knows its line. The only file behind it is
/// toml_document.cc, which alone meets the TOML library.
namespace palpate {

struct TomlEntry;
struct TomlValue;

using TomlArray = std::vector<TomlValue>;

struct TomlTable {
  std::vector<TomlEntry> entries;  ///< in order of their lines
  int line = 0;                    ///< of its header, or where it begins

  const TomlValue* find(std::string_view key) const;
};

/// A date or a time: no key of ours takes one.
struct TomlDate {};

struct TomlValue {
  std::variant<bool, std::int64_t, double, std::string, TomlDate, TomlArray, TomlTable> content;
  int line = 0;

  template <class T>
  const T* as() const {
    return std::get_if<T>(&content);
  }
};

struct TomlEntry {
  std::string key;
  TomlValue value;
};

/// @param max_bytes  longer texts are refused
/// @param source     names the text in errors, which carry the line
Result<TomlTable> parse_toml(std::string_view text, std::size_t max_bytes, const std::string& source);

}  // namespace palpate
