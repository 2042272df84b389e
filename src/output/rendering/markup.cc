#include "palpate/rendering/markup.h"

#include <algorithm>

#include "palpate/base/printable.h"

namespace palpate::markup {

std::string escape(std::string_view text) {
  std::string result;
  for (const char c : printable(text)) {
    switch (c) {
      case '&':
        result += "&amp;";
        break;
      case '<':
        result += "&lt;";
        break;
      case '>':
        result += "&gt;";
        break;
      case '"':
        result += "&quot;";
        break;
      case '\'':
        result += "&#39;";
        break;
      default:
        result += c;
    }
  }
  return result;
}

std::string css_colour(const Rgb& colour) {
  constexpr std::string_view kHexDigits = "0123456789abcdef";
  std::string result = "#";
  for (const std::uint8_t channel : {colour.r, colour.g, colour.b}) {
    result += kHexDigits[channel >> 4];
    result += kHexDigits[channel & 15];
  }
  return result;
}

std::string base64(std::span<const std::uint8_t> bytes) {
  constexpr std::string_view kDigits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string result;
  result.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t remaining = bytes.size() - i;
    std::uint32_t word = std::uint32_t{bytes[i]} << 16;
    if (remaining > 1) word |= std::uint32_t{bytes[i + 1]} << 8;
    if (remaining > 2) word |= bytes[i + 2];
    result += kDigits[word >> 18];
    result += kDigits[(word >> 12) & 63];
    result += remaining > 1 ? kDigits[(word >> 6) & 63] : '=';
    result += remaining > 2 ? kDigits[word & 63] : '=';
  }
  return result;
}

std::string side_text(Side side) {
  switch (side) {
    case Side::kLeft:
      return "LEFT";
    case Side::kRight:
      return "RIGHT";
    case Side::kBoth:
      return "";
    case Side::kUnknown:
      break;
  }
  return "SIDE UNKNOWN";
}

std::string side_mark(Side side, bool oriented) {
  if (!oriented) return "ORIENTATION UNKNOWN";
  const bool one_sided = side == Side::kLeft || side == Side::kRight;
  return (one_sided ? "Side: " : "") + side_text(side);
}

std::vector<std::string> doubt_marks(const Model& model) {
  const auto concerns = [&](CaveatKind kind) {
    return std::ranges::find(model.caveats, kind, &Caveat::kind) != model.caveats.end();
  };
  std::vector<std::string> marks;
  if (concerns(CaveatKind::kPlacement)) marks.emplace_back("PLACEMENT IN DOUBT");
  if (concerns(CaveatKind::kSide)) marks.emplace_back("SIDE IN DOUBT");
  return marks;
}

}  // namespace palpate::markup
