#include "palpate/base/printable.h"

#include <array>
#include <cstdint>
#include <utility>

namespace palpate {
namespace {

struct Character {
  std::size_t bytes = 0;  // 0: the text ends within the character
  bool whole = false;     // false: one byte that is not valid UTF-8
  char32_t code = 0;
};

// first character of a non-empty text
Character first_character(std::string_view text) {
  const auto byte = [&](std::size_t n) { return static_cast<unsigned char>(text[n]); };
  if (byte(0) < 0x80) return {1, true, byte(0)};
  const std::size_t length = byte(0) >= 0xF0 ? 4 : byte(0) >= 0xE0 ? 3 : 2;
  if (byte(0) < 0xC2 || byte(0) > 0xF4) return {1, false, byte(0)};
  char32_t code = byte(0) & (0x7Fu >> length);
  for (std::size_t n = 1; n < length; ++n) {
    if (n == text.size()) return {0, false, 0};
    if ((byte(n) & 0xC0) != 0x80) return {1, false, byte(0)};
    code = code << 6 | (byte(n) & 0x3Fu);
  }
  // overlong encoding, half of a surrogate pair, or beyond U+10FFFF
  constexpr std::array<char32_t, 5> kMinCode{0, 0, 0x80, 0x800, 0x10000};
  if (code < kMinCode[length] || (code >= 0xD800 && code < 0xE000) || code > 0x10FFFF)
    return {1, false, byte(0)};
  return {length, true, code};
}

// control, direction and invisible characters (printable())
bool must_be_escaped(char32_t code) {
  constexpr std::array<std::pair<char32_t, char32_t>, 10> kRanges{{{0, 0x1F},
                                                                   {0x7F, 0x9F},
                                                                   {0x61C, 0x61C},
                                                                   {0x200E, 0x200F},
                                                                   {0x2028, 0x202E},
                                                                   {0x2066, 0x206F},
                                                                   {0xFEFF, 0xFEFF},
                                                                   {0xFFF9, 0xFFFB},
                                                                   {0xE0000, 0xE007F},
                                                                   {0xFFFE, 0xFFFF}}};
  for (const auto& [first, last] : kRanges)
    if (code >= first && code <= last) return true;
  return false;
}

void append_hex(std::string& text, const char* begin, std::uint32_t value, int digits) {
  constexpr std::string_view kDigits = "0123456789abcdef";
  text += begin;
  for (int shift = 4 * (digits - 1); shift >= 0; shift -= 4) text += kDigits[value >> shift & 15];
}

void append_spelled_out(std::string& text, char32_t code) {
  if (code < 0x10000) return append_hex(text, "\\u", code, 4);
  append_hex(text, "\\u", 0xD7C0 + (code >> 10), 4);
  append_hex(text, "\\u", 0xDC00 + (code & 0x3FF), 4);
}

// appends the printable form of `text` and returns the rest: an incomplete character
std::string_view append_printable(std::string& shown, std::string_view text, bool line_ends) {
  while (!text.empty()) {
    const Character first = first_character(text);
    if (first.bytes == 0) break;
    const bool is_permitted = line_ends && (first.code == '\n' || first.code == '\t');
    if (!first.whole)
      append_hex(shown, "\\x", static_cast<std::uint32_t>(first.code), 2);
    else if (must_be_escaped(first.code) && !is_permitted)
      append_spelled_out(shown, first.code);
    else
      shown += text.substr(0, first.bytes);
    text.remove_prefix(first.bytes);
  }
  return text;
}

std::string all_printable(std::string_view text, bool line_ends) {
  std::string shown;
  shown.reserve(text.size());
  for (text = append_printable(shown, text, line_ends); !text.empty(); text.remove_prefix(1))
    append_hex(shown, "\\x", static_cast<unsigned char>(text.front()), 2);
  return shown;
}

}  // namespace

std::string printable(std::string_view text) {
  return all_printable(text, true);
}

std::string printable_name(std::string_view name) {
  return all_printable(name, false);
}

std::string PrintableStream::next(std::string_view piece) {
  begun_ += piece;
  std::string shown;
  begun_ = std::string(append_printable(shown, begun_, true));
  return shown;
}

}  // namespace palpate
