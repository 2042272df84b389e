#pragma once

#include <charconv>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

/// What the parsers of names and headers share.
namespace palpate::volume_io {

/// The next line, without its end (\n or \r\n), taken off `text`.
std::string_view take_line(std::string_view& text);

std::string_view trimmed(std::string_view text);
std::string lower_case(std::string_view text);
std::vector<std::string_view> split_at(std::string_view text, char separator);  ///< keeps empty fields
std::vector<std::string_view> split_spaces(std::string_view text);              ///< no empty fields

/// The whole of `text` as a decimal number, or nothing.
template <class T>
std::optional<T> parse_number(std::string_view text) {
  T value{};
  const auto result = std::from_chars(text.data(), text.data() + text.size(), value);
  if (result.ec != std::errc() || result.ptr != text.data() + text.size()) return std::nullopt;
  return value;
}

/// Why a text may not name a structure, or nothing: names go to terminals and web pages, so they are
/// UTF-8 without control characters, 1 to 256 bytes.
std::optional<std::string> name_fault(std::string_view name);

}  // namespace palpate::volume_io
