#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "palpate/base/result.h"

/// A TOML text as a plain tree in which every node has its line. toml_document.cc is the only source that
/// includes the TOML library.
namespace palpate {

struct TomlEntry;
struct TomlValue;

using TomlArray = std::vector<TomlValue>;

struct TomlTable {
  std::vector<TomlEntry> entries;  ///< In order of their lines
  int line = 0;                    ///< Line of its header, or of its first key

  const TomlValue* find(std::string_view key) const;
};

/// A date or time; no key accepts one.
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

/// @param max_bytes  maximum length of the text
/// @param source     name of the text in errors, which carry the line
Result<TomlTable> parse_toml(std::string_view text, std::size_t max_bytes, const std::string& source);

}  // namespace palpate
