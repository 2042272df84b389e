#include <gtest/gtest.h>

#include <random>

#include "base/test_seed.h"
#include "volume_io/streams/inflate.h"
#include "volume_io/streams/test_inflate.h"

namespace palpate::volume_io {
namespace {

using test::decoded;
using test::decoded_by_zlib;
using test::deflated;

constexpr int kZlib = 15, kGzip = 31;
constexpr std::size_t kMost = std::size_t{1} << 24;

enum class Content { kRuns, kText, kNoise, kFarCopies };

// bytes as of a label map, of a text, of noise that does not compress, and with copies from far back
std::string some_bytes(Content content, std::size_t count, std::mt19937& random) {
  std::string bytes;
  while (bytes.size() < count) switch (content) {
      case Content::kRuns:
        bytes.append(1 + random() % 3000, static_cast<char>(random() % 5));
        break;
      case Content::kText:
        bytes += std::to_string(random() % 1000) + " ";
        break;
      case Content::kNoise:
        bytes.push_back(static_cast<char>(random()));
        break;
      case Content::kFarCopies:
        for (int n = 0; n < 40; ++n) bytes.push_back(static_cast<char>(random()));
        if (bytes.size() > 33000) bytes.append(bytes, bytes.size() - 32700 - random() % 68, 50);
    }
  bytes.resize(count);
  return bytes;
}

TEST(Inflate, DecodesWhatZlibCompresses) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("PALPATE_TEST_SEED=" + std::to_string(seed));
  std::mt19937 random(seed);
  for (const Content content : {Content::kRuns, Content::kText, Content::kNoise, Content::kFarCopies})
    for (const int level : {0, 1, 6, 9})
      for (const int wrapper : {kZlib, kGzip})
        for (const int strategy : {Z_DEFAULT_STRATEGY, Z_FIXED, Z_HUFFMAN_ONLY, Z_RLE}) {
          const std::string bytes = some_bytes(content, random() % 200'000, random);
          const std::string packed = deflated(bytes, level, wrapper, strategy);
          const auto result = decoded(packed, kMost);
          EXPECT_EQ(result.fault, "");
          ASSERT_TRUE(result.bytes == bytes) << static_cast<int>(content) << ' ' << level << ' ' << strategy;
        }
}

TEST(Inflate, PiecesOfAnySizeGiveTheSame) {
  std::mt19937 random(test::test_seed());
  const std::string bytes = some_bytes(Content::kText, 3000, random);
  for (const int wrapper : {kZlib, kGzip})
    for (const std::size_t piece : {1, 2, 3, 7, 100}) {
      const auto result = decoded(deflated(bytes, 6, wrapper), kMost, piece);
      EXPECT_EQ(result.fault, "");
      EXPECT_TRUE(result.bytes == bytes) << piece;
    }
}

TEST(Inflate, GzipMembersAreJoinedAndOtherBytesAfterTheEndIgnored) {
  const std::string members = deflated("first ", 6, kGzip) + deflated("second", 9, kGzip);
  EXPECT_EQ(decoded(members, kMost), (test::Decoded{"first second", ""}));
  EXPECT_EQ(decoded(members + std::string(20, '\0'), kMost), (test::Decoded{"first second", ""}));
  EXPECT_EQ(decoded(members + "x", kMost), (test::Decoded{"first second", ""}));
  EXPECT_EQ(decoded(deflated("zlib", 6, kZlib) + "more", kMost), (test::Decoded{"zlib", ""}));
}

TEST(Inflate, OptionalFieldsOfAGzipHeaderAreSkipped) {
  const std::string plain = deflated("voxels", 6, kGzip);
  // extra field of 3 bytes, name, comment
  const std::string header = std::string("\x1f\x8b\x08\x1c\0\0\0\0\0\3", 10) + std::string("\3\0abc", 5) +
                             std::string("a.nii\0", 6) + std::string("made by\0", 8);
  EXPECT_EQ(decoded(header + plain.substr(10), kMost), (test::Decoded{"voxels", ""}));
  EXPECT_EQ(decoded_by_zlib(header + plain.substr(10), kMost), (test::Decoded{"voxels", ""}));
  for (std::size_t cut = 1; cut < header.size(); ++cut)
    EXPECT_EQ(decoded(header.substr(0, cut), kMost).fault, "the compressed data end early") << cut;
}

TEST(Inflate, ACutAnywhereIsAFault) {
  std::mt19937 random(test::test_seed());
  const std::string bytes = some_bytes(Content::kText, 2000, random);
  for (const int wrapper : {kZlib, kGzip}) {
    const std::string packed = deflated(bytes, 9, wrapper);
    for (std::size_t size = 0; size < packed.size(); ++size) {
      const auto result = decoded(packed.substr(0, size), kMost);
      ASSERT_EQ(result.fault, "the compressed data end early") << size;
      ASSERT_TRUE(bytes.starts_with(result.bytes)) << size;
    }
  }
}

// the same bytes and the same reason as zlib's, for every kind of damage
TEST(Inflate, DamageIsRejectedAsByZlib) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("PALPATE_TEST_SEED=" + std::to_string(seed));
  std::mt19937 random(seed);
  int rejected = 0;
  for (int round = 0; round < 3000; ++round) {
    const std::string bytes = some_bytes(static_cast<Content>(round % 4), 20 + random() % 400, random);
    std::string packed =
        deflated(bytes, 9, round % 8 < 4 ? kZlib : kGzip, round % 3 == 0 ? Z_FIXED : Z_DEFAULT_STRATEGY);
    for (auto n = 1 + random() % 3; n > 0; --n)
      packed[random() % packed.size()] ^= static_cast<char>(1 << random() % 8);
    if (round % 5 == 0) packed.resize(random() % packed.size());
    const auto ours = decoded(packed, kMost), zlibs = decoded_by_zlib(packed, kMost);
    ASSERT_EQ(ours.fault, zlibs.fault) << "round " << round;
    if (ours.fault.find("end early") == std::string::npos) {
      ASSERT_TRUE(ours.bytes == zlibs.bytes) << "round " << round << ": " << ours.fault;
    }
    rejected += !ours.fault.empty();
  }
  EXPECT_GT(rejected, 2000);
}

}  // namespace
}  // namespace palpate::volume_io
