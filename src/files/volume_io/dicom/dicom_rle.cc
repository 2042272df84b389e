#include "volume_io/dicom/dicom_rle.h"

#include <algorithm>
#include <array>

namespace palpate::volume_io {
namespace {

using RleBytes = std::span<const std::uint8_t>;

constexpr std::size_t kRleNumbers = 16, kRleHeaderBytes = 4 * kRleNumbers;

// numbers of the header, little endian
std::array<std::uint32_t, kRleNumbers> numbers_of_header(RleBytes packed) {
  std::array<std::uint32_t, kRleNumbers> numbers{};
  for (std::size_t byte = 0; byte < kRleHeaderBytes; ++byte)
    numbers[byte / 4] |= std::uint32_t{packed[byte]} << (8 * (byte % 4));
  return numbers;
}

// Decompresses one segment: calls put(n, byte) for the n-th of `count` bytes; returns false if it is damaged.
// A byte that pads an odd length is ignored.
template <class Put>
bool unpack_segment(RleBytes segment, std::size_t count, const Put& put) {
  const std::size_t largest = count + count % 2;
  std::size_t in = 0, out = 0;
  while (out < count) {
    if (in == segment.size()) return false;
    const std::size_t control = segment[in++];
    constexpr std::size_t kNothing = 128;
    if (control == kNothing) continue;
    const bool repeated = control > kNothing;
    const std::size_t run = repeated ? 257 - control : control + 1, taken = repeated ? 1 : run;
    if (run > largest - out || taken > segment.size() - in) return false;
    for (std::size_t n = 0; n < run && out < count; ++n) put(out++, segment[in + (repeated ? 0 : n)]);
    in += taken;
  }
  return true;
}

}  // namespace

bool unpack_rle(std::span<const std::uint8_t> packed, std::size_t word_bytes, std::span<std::uint8_t> words) {
  if (packed.size() < kRleHeaderBytes) return false;
  const auto numbers = numbers_of_header(packed);
  if (numbers[0] != word_bytes || word_bytes >= kRleNumbers) return false;
  for (std::size_t segment = 0; segment < word_bytes; ++segment) {
    const bool last = segment + 1 == word_bytes;
    const std::size_t first = numbers[1 + segment], end = last ? packed.size() : numbers[2 + segment];
    if (first < kRleHeaderBytes || first > end || end > packed.size()) return false;
    const std::size_t byte = word_bytes - 1 - segment;
    const auto put = [&](std::size_t n, std::uint8_t value) { words[n * word_bytes + byte] = value; };
    if (!unpack_segment(packed.subspan(first, end - first), words.size() / word_bytes, put)) return false;
  }
  return true;
}

}  // namespace palpate::volume_io
