#include <array>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <string_view>

#include "palpate/base/reading.h"

namespace palpate {

std::string memory_size_text(std::uint64_t bytes) {
  constexpr std::array<const char*, 4> kUnits{"KiB", "MiB", "GiB", "TiB"};
  double amount = static_cast<double>(bytes) / 1024;
  std::size_t unit = 0;
  for (; amount >= 1024 && unit + 1 < kUnits.size(); ++unit) amount /= 1024;
  char text[40];
  std::snprintf(text, sizeof text, "%.1f %s", amount, kUnits[unit]);
  return text;
}

std::uint64_t parse_memory_size(const std::string& text) {
  double amount = 0;
  const auto read = std::from_chars(text.data(), text.data() + text.size(), amount, std::chars_format::fixed);
  std::string_view unit(read.ptr, static_cast<std::size_t>(text.data() + text.size() - read.ptr));
  while (unit.starts_with(' ')) unit.remove_prefix(1);
  if (read.ec != std::errc() || unit.empty()) return 0;
  constexpr std::string_view kUnits = "KMGT";
  const auto power = kUnits.find(static_cast<char>(unit.front() & ~0x20));
  unit.remove_prefix(1);
  if (power == std::string_view::npos || !(unit.empty() || unit == "iB" || unit == "B")) return 0;
  const double bytes = std::ldexp(amount, 10 * (static_cast<int>(power) + 1));
  return bytes >= 1 && bytes < 0x1p63 ? static_cast<std::uint64_t>(bytes) : 0;
}

}  // namespace palpate
