#include "volume_io/dicom/dicom_jpeg2000.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "base/test_seed.h"
#include "volume_io/dicom/test_jpeg2000.h"

namespace palpate::volume_io {
namespace {

using test::Jpeg2000Coding;
using Samples = std::vector<std::int32_t>;
using Codestream = std::vector<std::uint8_t>;

constexpr int kRows = 21, kColumns = 34;

std::string in_words(const Jpeg2000Coding& coding) {
  return std::to_string(coding.bits) + " bits, sign " + std::to_string(coding.is_signed) + ", tile " +
         std::to_string(coding.tile) + ", layers " + std::to_string(coding.layers);
}

// samples over the full range, smooth in places and rough in others
template <class Random>
Samples samples_of(const Jpeg2000Coding& coding, Random& random) {
  const std::int32_t low = coding.is_signed ? -(1 << (coding.bits - 1)) : 0,
                     high = low + (1 << coding.bits) - 1;
  std::uniform_int_distribution<std::int32_t> any(low, high);
  Samples samples;
  for (int j = 0; j < kRows; ++j)
    for (int i = 0; i < kColumns; ++i)
      samples.push_back(i < 20 ? std::min(high, low + (i * j) % (1 << coding.bits)) : any(random));
  samples[5] = low;
  samples[6] = high;
  return samples;
}

std::size_t word_bytes_of(int bits) {
  return bits <= 8 ? 1 : bits <= 16 ? 2 : 4;
}

// decompressed samples, as words of a data set; nullopt if the frame is rejected
std::optional<Codestream> unpacked(const Codestream& packed, std::size_t word_bytes) {
  // exactly sized memory, for the sanitizers
  const Codestream exactly(packed);
  const auto header = read_jpeg2000_header(exactly);
  if (!header || header->rows != kRows || header->columns != kColumns || header->components != 1 ||
      header->tiles > 64)
    return std::nullopt;
  Codestream words(std::size_t{kRows} * kColumns * word_bytes);
  if (!unpack_jpeg2000(*header, exactly, word_bytes, words)) return std::nullopt;
  return words;
}

Codestream words_of(const Samples& samples, std::size_t word_bytes) {
  Codestream words;
  for (const std::int32_t sample : samples)
    for (std::size_t byte = 0; byte < word_bytes; ++byte)
      words.push_back(static_cast<std::uint8_t>(static_cast<std::uint32_t>(sample) >> (8 * byte)));
  return words;
}

TEST(DicomJpeg2000, RoundTrips) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  for (const int bits : {1, 8, 10, 12, 16})
    for (const bool is_signed : {false, true})
      for (const int tile : {0, 16})
        for (const int layers : {1, 3}) {
          const Jpeg2000Coding coding{bits, is_signed, false, tile, layers};
          SCOPED_TRACE(in_words(coding));
          const Samples samples = samples_of(coding, random);
          const Codestream packed = test::pack_jpeg2000(kRows, kColumns, samples, coding);
          const auto header = read_jpeg2000_header(packed);
          ASSERT_TRUE(header);
          EXPECT_EQ(header->bits, bits);
          EXPECT_EQ(header->is_signed, is_signed);
          EXPECT_EQ(header->tiles, tile ? 6u : 1u);
          EXPECT_FALSE(header->irreversible || header->high_throughput || header->subsampled);
          EXPECT_EQ(unpacked(packed, word_bytes_of(bits)), words_of(samples, word_bytes_of(bits)));
        }
}

TEST(DicomJpeg2000, ReportsLossyCompression) {
  std::mt19937 random(1);
  const Jpeg2000Coding coding{12, false, true};
  const Samples samples = samples_of(coding, random);
  const Codestream packed = test::pack_jpeg2000(kRows, kColumns, samples, coding);
  EXPECT_TRUE(read_jpeg2000_header(packed)->irreversible);
  const auto words = unpacked(packed, 2);
  ASSERT_TRUE(words);
  EXPECT_NE(words, words_of(samples, 2));
}

TEST(DicomJpeg2000, HeadersNameUnsupportedFeatures) {
  std::mt19937 random(2);
  const Jpeg2000Coding coding{12};
  const Codestream packed = test::pack_jpeg2000(kRows, kColumns, samples_of(coding, random), coding);
  // SOC, SIZ: its length at 4, capabilities at 6, positions from 8 on, components at 40
  const auto changed = [&](std::size_t at, int value) {
    Codestream bytes = packed;
    bytes[at] = static_cast<std::uint8_t>(value);
    return read_jpeg2000_header(bytes);
  };
  EXPECT_TRUE(changed(6, 0x40)->high_throughput);
  EXPECT_TRUE(changed(43, 2)->subsampled);
  EXPECT_EQ(changed(11, kColumns + 1)->columns, kColumns + 1u);
  // tiles of 1 x 1
  Codestream tiny = packed;
  for (const std::size_t at : {24, 25, 26, 28, 29, 30}) tiny[at] = 0;
  tiny[27] = tiny[31] = 1;
  EXPECT_EQ(read_jpeg2000_header(tiny)->tiles, std::uint64_t{kRows} * kColumns);
  tiny[27] = 0;
  EXPECT_FALSE(read_jpeg2000_header(tiny));
  // the coding style, after the SIZ segment
  constexpr std::uint8_t kCodingStyle[] = {0xFF, 0x52};
  const auto coding_style =
      std::search(packed.begin(), packed.end(), std::begin(kCodingStyle), std::end(kCodingStyle));
  ASSERT_NE(coding_style, packed.end());
  const auto block_style = static_cast<std::size_t>(coding_style - packed.begin()) + 12;
  EXPECT_TRUE(changed(block_style, 0x40)->high_throughput);
  for (std::size_t length = 0; length < block_style + 2; ++length)
    EXPECT_FALSE(read_jpeg2000_header(std::span(packed).first(length))) << length;
  EXPECT_TRUE(read_jpeg2000_header(std::span(packed).first(block_style + 2)));
}

TEST(DicomJpeg2000, CutAnywhereItIsRefused) {
  std::mt19937 random(3);
  for (const int tile : {0, 16}) {
    const Jpeg2000Coding coding{12, true, false, tile};
    const Samples samples = samples_of(coding, random);
    const Codestream packed = test::pack_jpeg2000(kRows, kColumns, samples, coding);
    // the end marker is not needed to decode the image
    constexpr std::size_t kEndMarker = 2;
    for (std::size_t length = 0; length + kEndMarker < packed.size(); ++length)
      EXPECT_FALSE(
          unpacked(Codestream(packed.begin(), packed.begin() + static_cast<std::ptrdiff_t>(length)), 2))
          << length << " of " << packed.size();
  }
}

// for sanitizers
TEST(DicomJpeg2000, AnyBytesAreUnpackedOrRefused) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  int accepted = 0;
  for (int n = 0; n < 400; ++n) {
    const Jpeg2000Coding coding{n % 2 ? 8 : 12, n % 3 == 0, n % 5 == 0, n % 7 == 0 ? 16 : 0};
    Codestream packed = test::pack_jpeg2000(kRows, kColumns, samples_of(coding, random), coding);
    for (unsigned flips = 1 + random() % 4; flips > 0; --flips) {
      const std::size_t largest = random() % 2 ? packed.size() : 120;
      packed[random() % largest] ^= static_cast<std::uint8_t>(1u << (random() % 8));
    }
    accepted += unpacked(packed, word_bytes_of(coding.bits)).has_value();
  }
  EXPECT_GT(accepted, 40);
  EXPECT_LT(accepted, 360);
}

}  // namespace
}  // namespace palpate::volume_io
