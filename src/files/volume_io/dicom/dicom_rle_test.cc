#include "volume_io/dicom/dicom_rle.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "base/test_seed.h"

namespace palpate::volume_io {
namespace {

using PlainBytes = std::vector<std::uint8_t>;

// PackBits as in PS3.5 G.3.1, in pieces of random length
template <class Random>
PlainBytes pack_bits(const PlainBytes& plain, Random& random) {
  PlainBytes packed;
  for (std::size_t at = 0; at < plain.size();) {
    std::size_t same = 1;
    while (at + same < plain.size() && plain[at + same] == plain[at]) ++same;
    const auto most = std::uniform_int_distribution<std::size_t>(1, 128)(random);
    if (random() % 8 == 0) packed.push_back(0x80);  // a no-op
    if (same >= 2 && most >= 2) {
      const std::size_t run = std::min(same, most);
      packed.push_back(static_cast<std::uint8_t>(257 - run));
      packed.push_back(plain[at]);
      at += run;
    } else {
      const std::size_t run = std::min(plain.size() - at, most);
      packed.push_back(static_cast<std::uint8_t>(run - 1));
      packed.insert(packed.end(), plain.begin() + static_cast<std::ptrdiff_t>(at),
                    plain.begin() + static_cast<std::ptrdiff_t>(at + run));
      at += run;
    }
  }
  return packed;
}

void append_number(PlainBytes& bytes, std::size_t index, std::size_t number) {
  for (std::size_t byte = 0; byte < 4; ++byte)
    bytes[4 * index + byte] = static_cast<std::uint8_t>(number >> (8 * byte));
}

// frame of little-endian words
template <class Random>
PlainBytes pack_frame(const PlainBytes& words, std::size_t word_bytes, Random& random) {
  PlainBytes packed(64);
  append_number(packed, 0, word_bytes);
  for (std::size_t segment = 0; segment < word_bytes; ++segment) {
    append_number(packed, 1 + segment, packed.size());
    PlainBytes plane;
    for (std::size_t n = word_bytes - 1 - segment; n < words.size(); n += word_bytes)
      plane.push_back(words[n]);
    const PlainBytes piece = pack_bits(plane, random);
    packed.insert(packed.end(), piece.begin(), piece.end());
    if (packed.size() % 2) packed.push_back(0);
  }
  return packed;
}

// words with constant stretches
template <class Random>
PlainBytes random_words(std::size_t bytes, Random& random) {
  PlainBytes words;
  while (words.size() < bytes)
    words.insert(words.end(), 1 + random() % (random() % 2 ? 3 : 300), static_cast<std::uint8_t>(random()));
  words.resize(bytes);
  return words;
}

// decompressed into exactly sized memory, so that sanitizers detect accesses beyond it
std::optional<PlainBytes> unpacked(const PlainBytes& packed, std::size_t word_bytes, std::size_t bytes) {
  PlainBytes words(bytes);
  const PlainBytes exactly(packed);
  if (!unpack_rle(exactly, word_bytes, words)) return std::nullopt;
  return words;
}

TEST(DicomRle, RoundTrips) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  for (int n = 0; n < 600; ++n) {
    const std::size_t word_bytes = std::size_t{1} << (n % 3), count = random() % 500;
    const PlainBytes words = random_words(count * word_bytes, random);
    EXPECT_EQ(unpacked(pack_frame(words, word_bytes, random), word_bytes, words.size()), words);
  }
}

// the standard PackBits example (Apple, Technical Note TN1023)
TEST(DicomRle, TheKnownExample) {
  PlainBytes packed(64);
  append_number(packed, 0, 1);
  append_number(packed, 1, 64);
  for (const int byte :
       {0xFE, 0xAA, 0x02, 0x80, 0x00, 0x2A, 0xFD, 0xAA, 0x03, 0x80, 0x00, 0x2A, 0x22, 0xF7, 0xAA})
    packed.push_back(static_cast<std::uint8_t>(byte));
  const PlainBytes plain{0xAA, 0xAA, 0xAA, 0x80, 0x00, 0x2A, 0xAA, 0xAA, 0xAA, 0xAA, 0x80, 0x00,
                         0x2A, 0x22, 0xAA, 0xAA, 0xAA, 0xAA, 0xAA, 0xAA, 0xAA, 0xAA, 0xAA, 0xAA};
  EXPECT_EQ(unpacked(packed, 1, plain.size()), plain);
}

TEST(DicomRle, AnOddNumberMayBePaddedByOneByte) {
  std::mt19937 random(3);
  for (const std::size_t count : {std::size_t{14}, std::size_t{15}}) {
    PlainBytes plain = random_words(count + 1, random);
    const PlainBytes packed = pack_frame(plain, 1, random);
    plain.pop_back();
    EXPECT_EQ(unpacked(packed, 1, count).has_value(), count == 15);
    if (count == 15) {
      EXPECT_EQ(unpacked(packed, 1, count), plain);
    }
  }
}

TEST(DicomRle, CutAnywhereItIsRefused) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  for (const std::size_t word_bytes : {1, 2, 4}) {
    const PlainBytes words = random_words(150 * word_bytes, random);
    PlainBytes packed = pack_frame(words, word_bytes, random);
    // without the padding
    while (unpacked(PlainBytes(packed.begin(), packed.end() - 1), word_bytes, words.size()))
      packed.pop_back();
    for (std::size_t length = 0; length < packed.size(); ++length)
      EXPECT_FALSE(unpacked(PlainBytes(packed.begin(), packed.begin() + static_cast<std::ptrdiff_t>(length)),
                            word_bytes, words.size()))
          << length;
  }
}

TEST(DicomRle, HeadersThatPointElsewhereAreRefused) {
  std::mt19937 random(5);
  const PlainBytes words = random_words(200, random);
  const PlainBytes packed = pack_frame(words, 2, random);
  ASSERT_TRUE(unpacked(packed, 2, 200));
  for (const std::size_t wrong : {std::size_t{0}, std::size_t{63}, packed.size() + 1, ~std::size_t{0}})
    for (const std::size_t index : {1, 2}) {
      PlainBytes bytes = packed;
      append_number(bytes, index, wrong);
      EXPECT_FALSE(unpacked(bytes, 2, 200)) << index << " at " << wrong;
    }
  for (const std::size_t segments : {0u, 1u, 3u, 15u, 16u, ~0u}) {
    PlainBytes bytes = packed;
    append_number(bytes, 0, segments);
    EXPECT_FALSE(unpacked(bytes, 2, 200));
  }
  EXPECT_FALSE(unpacked(packed, 16, 160));
}

// for sanitizers
TEST(DicomRle, AnyBytesAreUnpackedOrRefused) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  int accepted = 0;
  for (int n = 0; n < 4000; ++n) {
    const std::size_t word_bytes = std::size_t{1} << (n % 3);
    PlainBytes packed = n % 2 ? pack_frame(random_words(40 * word_bytes, random), word_bytes, random)
                              : random_words(64 + random() % 200, random);
    if (n % 4 == 0) {
      std::fill_n(packed.begin(), 64, std::uint8_t{0});
      append_number(packed, 0, word_bytes);
      for (std::size_t segment = 0; segment < word_bytes; ++segment)
        append_number(packed, 1 + segment, 64 + random() % packed.size() * segment / word_bytes);
    }
    for (unsigned flips = random() % 4; flips > 0; --flips)
      packed[random() % packed.size()] ^= static_cast<std::uint8_t>(1u << (random() % 8));
    packed.resize(random() % 8 ? packed.size() : random() % packed.size());
    accepted += unpacked(packed, word_bytes, 40 * word_bytes).has_value();
  }
  EXPECT_GT(accepted, 400);
  EXPECT_LT(accepted, 3500);
}

}  // namespace
}  // namespace palpate::volume_io
