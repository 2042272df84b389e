#include "volume_io/labels/label_text.h"

namespace palpate::volume_io {
namespace {

constexpr std::string_view kSpaces = " \t\r\n\v\f";

// size of the UTF-8 character at the front; bytes, 0 if it is invalid (RFC 3629)
std::size_t character_bytes(std::string_view text) {
  const auto at = [&](std::size_t n) { return static_cast<unsigned char>(text[n]); };
  const unsigned char lead = at(0);
  if (lead < 0x80) return 1;
  std::size_t bytes = 0;
  unsigned char low = 0x80, high = 0xBF;  // bounds of the second byte, excluding overlong forms and
                                          // surrogates
  if (lead >= 0xC2 && lead <= 0xDF) bytes = 2;
  if (lead >= 0xE0 && lead <= 0xEF) bytes = 3;
  if (lead >= 0xF0 && lead <= 0xF4) bytes = 4;
  if (lead == 0xE0) low = 0xA0;
  if (lead == 0xED) high = 0x9F;
  if (lead == 0xF0) low = 0x90;
  if (lead == 0xF4) high = 0x8F;
  if (bytes == 0 || text.size() < bytes || at(1) < low || at(1) > high) return 0;
  for (std::size_t n = 2; n < bytes; ++n)
    if (at(n) < 0x80 || at(n) > 0xBF) return 0;
  return bytes;
}

}  // namespace

std::string_view read_line(std::string_view& text) {
  const auto end = text.find('\n');
  std::string_view line = text.substr(0, end);
  text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
  if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
  return line;
}

std::string_view trimmed(std::string_view text) {
  const auto first = text.find_first_not_of(kSpaces);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kSpaces) - first + 1);
}

std::string lower_case(std::string_view text) {
  std::string lower(text);
  for (char& c : lower)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  return lower;
}

std::vector<std::string_view> split_at(std::string_view text, char separator) {
  std::vector<std::string_view> fields;
  while (true) {
    const auto end = text.find(separator);
    fields.push_back(text.substr(0, end));
    if (end == std::string_view::npos) return fields;
    text.remove_prefix(end + 1);
  }
}

std::vector<std::string_view> split_spaces(std::string_view text) {
  std::vector<std::string_view> fields;
  for (text = trimmed(text); !text.empty(); text = trimmed(text)) {
    const auto end = std::min(text.find_first_of(kSpaces), text.size());
    fields.push_back(text.substr(0, end));
    text.remove_prefix(end);
  }
  return fields;
}

std::optional<std::string> name_fault(std::string_view name) {
  if (name.empty()) return "the name is empty";
  if (name.size() > 256) return "the name is longer than 256 bytes";
  while (!name.empty()) {
    const std::size_t bytes = character_bytes(name);
    if (bytes == 0) return "the name is not UTF-8 text";
    if (static_cast<unsigned char>(name[0]) < 0x20 || name[0] == 0x7f)
      return "the name holds a control character";
    // the C1 control characters, U+0080 to U+009F
    if (bytes == 2 && static_cast<unsigned char>(name[0]) == 0xC2 &&
        static_cast<unsigned char>(name[1]) < 0xA0)
      return "the name holds a control character";
    name.remove_prefix(bytes);
  }
  return std::nullopt;
}

}  // namespace palpate::volume_io
