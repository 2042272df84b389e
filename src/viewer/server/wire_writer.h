#pragma once

#include <array>
#include <bit>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <limits>

namespace palpate::server {

/// Converts to float; values beyond the range of float become infinite.
inline float wire_float(double value) {
  constexpr double kMaxFloat = std::numeric_limits<float>::max();
  constexpr float kInfinite = std::numeric_limits<float>::infinity();
  if (std::abs(value) > kMaxFloat) return std::copysign(kInfinite, static_cast<float>(value > 0 ? 1 : -1));
  return static_cast<float>(value);
}

/// Writes consecutive numbers in little-endian order on any machine.
class WireWriter {
 public:
  explicit WireWriter(char* at) : at_(at) {}

  template <std::unsigned_integral T>
  void unsigned_integer(T value) {
    for (std::size_t byte = 0; byte < sizeof(T); ++byte)
      *at_++ = static_cast<char>(static_cast<std::uint64_t>(value) >> (8 * byte) & 0xff);
  }
  void real64(double value) { unsigned_integer(std::bit_cast<std::uint64_t>(value)); }
  void real32(double value) { unsigned_integer(std::bit_cast<std::uint32_t>(wire_float(value))); }
  template <std::size_t kCount>
  void reals32(const std::array<double, kCount>& values) {
    for (const double value : values) real32(value);
  }
  const char* at() const { return at_; }

 private:
  char* at_;
};

}  // namespace palpate::server
