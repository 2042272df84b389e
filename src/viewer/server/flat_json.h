#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

/// JSON subset accepted from viewers: one object of plain values and lists of numbers, without deeper
/// nesting. Implemented in flat_json.cc alone.
namespace palpate::server {

using FlatValue = std::variant<bool, std::int64_t, double, std::string, std::vector<double>>;

struct FlatObject {
  std::vector<std::pair<std::string, FlatValue>> entries;  ///< Keys are unique

  const FlatValue* find(std::string_view key) const;
};

/// Empty if the text is not such an object: malformed, nested, a duplicate key, null, a number beyond
/// double's range, a list of other values than numbers. Memory and time are linear in the length of the text.
std::optional<FlatObject> parse_flat_json(std::string_view text);

}  // namespace palpate::server
