#pragma once

#include <charconv>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

/// Text functions shared by the parsers of names and headers.
namespace palpate::volume_io {

/// Removes the next line from `text` and returns it without its line end (\n or \r\n).
std::string_view read_line(std::string_view& text);

std::string_view trimmed(std::string_view text);
std::string lower_case(std::string_view text);
std::vector<std::string_view> split_at(std::string_view text, char separator);  ///< Keeps empty fields.
std::vector<std::string_view> split_spaces(std::string_view text);              ///< No empty fields.

/// Parses all of `text` as a decimal number; nullopt otherwise.
template <class T>
std::optional<T> parse_number(std::string_view text) {
  T value{};
  const auto result = std::from_chars(text.data(), text.data() + text.size(), value);
  if (result.ec != std::errc() || result.ptr != text.data() + text.size()) return std::nullopt;
  return value;
}

/// Why a text is invalid as a structure name, or nullopt. Names are shown on terminals and web pages, so they
/// must be UTF-8 without control characters, 1 to 256 bytes.
std::optional<std::string> name_fault(std::string_view name);

}  // namespace palpate::volume_io
