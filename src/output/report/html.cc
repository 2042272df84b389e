#include "report/html.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <vector>

#include "palpate/base/printable.h"

namespace palpate::report {
namespace {

constexpr std::string_view kHexDigits = "0123456789abcdef";

bool is_control(char c) {
  return static_cast<unsigned char>(c) < 0x20 || c == 0x7f;
}

std::string fixed(double value, int decimals) {
  // sufficient for the largest double
  std::array<char, 400> buffer;
  const auto end =
      std::to_chars(buffer.data(), buffer.data() + buffer.size(), value, std::chars_format::fixed, decimals);
  std::string text(buffer.data(), end.ptr);
  const bool is_zero = text.find_first_not_of("-0.") == std::string::npos;
  return is_zero && text.front() == '-' ? text.substr(1) : text;
}

std::uint8_t hex_value(char digit) {
  return static_cast<std::uint8_t>(kHexDigits.find(digit));
}

}  // namespace

std::string json_string(std::string_view text) {
  std::string result = "\"";
  for (const char c : printable(text)) {
    // '<' would allow a name to close the script element
    if (is_control(c) || c == '"' || c == '\\' || c == '<' || c == '>' || c == '&') {
      result += "\\u00";
      result += kHexDigits[static_cast<unsigned char>(c) >> 4];
      result += kHexDigits[static_cast<unsigned char>(c) & 15];
    } else {
      result += c;
    }
  }
  return result + '"';
}

std::string json_number(double value, int decimals) {
  if (!std::isfinite(value)) return "null";
  std::string text = fixed(value, decimals);
  if (text.find('.') != std::string::npos) {
    text.erase(text.find_last_not_of('0') + 1);
    if (text.back() == '.') text.pop_back();
  }
  return text;
}

std::string number(double value, int decimals) {
  return std::isfinite(value) ? fixed(value, decimals) : "-";
}

std::string three_digits(double value) {
  if (value == 0 || !std::isfinite(value)) return number(value, 0);
  constexpr int kDigits = 3;
  const auto decimals_of = [](double of) {
    return kDigits - 1 - static_cast<int>(std::floor(std::log10(std::abs(of))));
  };
  // 9.996 is rounded up to 10.0
  const double step = std::pow(10.0, -decimals_of(value));
  const double rounded = std::round(value / step) * step;
  return number(rounded, std::max(0, decimals_of(rounded)));
}

std::string depth_text(double depth_mm) {
  if (!std::isfinite(depth_mm)) return "not measured";
  const std::string text = number(depth_mm, 2) + " mm";
  if (text.front() != '-') return text;
  return text + ", " + number(-depth_mm, 2) + " mm in front of the segmented surface";
}

std::string grouped(std::uint64_t value) {
  constexpr std::string_view kNarrowSpace = "\u202f";
  const std::string digits = std::to_string(value);
  std::string result;
  for (std::size_t i = 0; i < digits.size(); ++i) {
    if (i > 0 && (digits.size() - i) % 3 == 0) result += kNarrowSpace;
    result += digits[i];
  }
  return result;
}

std::string hex(std::uint64_t value) {
  std::string result;
  for (int shift = 60; shift >= 0; shift -= 4) result += kHexDigits[(value >> shift) & 15];
  return result;
}

std::string cell(const std::string& value) {
  return "<td>" + value + "</td>";
}

std::string entry(const std::string& term, const std::string& value, bool code) {
  if (value.empty()) return "";
  const std::string content = code ? "<code>" + escape(value) + "</code>" : escape(value);
  return "<div><dt>" + term + "</dt><dd>" + content + "</dd></div>\n";
}

std::string csp_hash(std::string_view sha256_hex) {
  std::vector<std::uint8_t> bytes;
  for (std::size_t i = 0; i + 1 < sha256_hex.size(); i += 2) {
    bytes.push_back(static_cast<std::uint8_t>(hex_value(sha256_hex[i]) << 4 | hex_value(sha256_hex[i + 1])));
  }
  return "'sha256-" + base64(bytes) + "'";
}

}  // namespace palpate::report
