#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

/// JSON as viewers may send it: one object of plain values and lists of numbers, nothing deeper. The only
/// file behind it is flat_json.cc.
namespace palpate::link {

using FlatValue = std::variant<bool, std::int64_t, double, std::string, std::vector<double>>;

struct FlatObject {
  std::vector<std::pair<std::string, FlatValue>> entries;  ///< each key once

  const FlatValue* find(std::string_view key) const;
};

/// Nothing where the text is no such object: malformed, deeper, a key twice, null, a number that no double
/// holds, a list of anything but numbers. Takes memory and time in proportion to the text.
std::optional<FlatObject> parse_flat_json(std::string_view text);

}  // namespace palpate::link
