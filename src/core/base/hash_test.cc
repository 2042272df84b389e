#include "palpate/base/hash.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace palpate {
namespace {

std::uint64_t hash_of(const std::string& bytes) {
  std::uint64_t hash = kHashSeed;
  hash_bytes(hash, bytes.data(), bytes.size());
  return hash_finish(hash);
}

TEST(Hash, IsGolden) {
  // pinned: recordings of older versions must remain valid
  EXPECT_EQ(hash_of("palpate"), 4386694648486293637ull);
  EXPECT_EQ(hash_of("the tip touches the femur"), 13214131960942926874ull);
}

TEST(Hash, EveryBitOfALongInputChangesTheHash) {
  std::string bytes(100, 'x');
  std::set<std::uint64_t> visited{hash_of(bytes)};
  for (std::size_t i = 0; i < bytes.size(); ++i)
    for (int bit = 0; bit < 8; ++bit) {
      std::string changed = bytes;
      changed[i] = static_cast<char>(changed[i] ^ (1 << bit));
      EXPECT_TRUE(visited.insert(hash_of(changed)).second) << i << " " << bit;
    }
}

TEST(Hash, LengthAndOrderChangeTheHash) {
  EXPECT_NE(hash_of(""), hash_of(std::string(1, '\0')));
  EXPECT_NE(hash_of(std::string(8, '\0')), hash_of(std::string(16, '\0')));
  EXPECT_NE(hash_of("abcdefgh12345678"), hash_of("12345678abcdefgh"));
}

TEST(WordHasher, EveryBitAndTheOrderChangeTheHash) {
  constexpr std::size_t kWords = 41;
  const auto hash_of_words = [](const std::vector<std::uint64_t>& words) {
    WordHasher hash;
    for (const std::uint64_t word : words) hash.add(word);
    return hash.value();
  };
  std::set<std::uint64_t> visited;
  std::vector<std::uint64_t> words;
  // any number of zeros, and each single bit of the longest sequence
  for (std::size_t n = 0; n <= kWords; ++n) {
    EXPECT_TRUE(visited.insert(hash_of_words(words)).second) << n;
    if (n < kWords) words.push_back(0);
  }
  for (std::uint64_t& word : words)
    for (int bit = 0; bit < 64; ++bit) {
      word ^= std::uint64_t{1} << bit;
      EXPECT_TRUE(visited.insert(hash_of_words(words)).second) << bit;
      word ^= std::uint64_t{1} << bit;
    }
  // any two words exchanged, including two of one chain
  for (std::size_t n = 0; n < kWords; ++n) words[n] = n + 1;
  visited.insert(hash_of_words(words));
  for (std::size_t a = 0; a < kWords; ++a)
    for (std::size_t b = a + 1; b < kWords; ++b) {
      std::swap(words[a], words[b]);
      EXPECT_TRUE(visited.insert(hash_of_words(words)).second) << a << " " << b;
      std::swap(words[a], words[b]);
    }
}

TEST(WordHasher, LengthBitsAndOrderOfBytesChangeTheHash) {
  constexpr std::size_t kBytes = 5000;
  std::vector<unsigned char> bytes(kBytes);
  for (std::size_t n = 0; n < kBytes; ++n)
    bytes[n] = static_cast<unsigned char>(n % 8 == 0 ? n / 8 : n / 2048);
  const auto hash_of_bytes = [&](std::size_t size) {
    WordHasher hash;
    hash.add_bytes(bytes.data(), size);
    return hash.value();
  };
  std::set<std::uint64_t> visited;
  for (std::size_t size = 0; size <= kBytes; ++size)
    EXPECT_TRUE(visited.insert(hash_of_bytes(size)).second) << size;
  // each byte changed, and the first word exchanged with any other
  for (unsigned char& byte : bytes) {
    byte ^= 1;
    EXPECT_TRUE(visited.insert(hash_of_bytes(kBytes)).second);
    byte ^= 1;
  }
  for (std::size_t n = 8; n + 8 <= kBytes; n += 8) {
    std::swap_ranges(bytes.begin(), bytes.begin() + 8, bytes.begin() + static_cast<std::ptrdiff_t>(n));
    EXPECT_TRUE(visited.insert(hash_of_bytes(kBytes)).second) << n;
    std::swap_ranges(bytes.begin(), bytes.begin() + 8, bytes.begin() + static_cast<std::ptrdiff_t>(n));
  }
  // the same words one by one, the last one padded with zeros, at any position in the buffer
  for (const std::size_t size : {kBytes, kBytes - 3, kBytes - 7}) {
    std::vector<std::uint64_t> words((size + 7) / 8);
    std::memcpy(words.data(), bytes.data(), size);
    for (std::size_t before = 0; before < 300; before += 7) {
      WordHasher at_once, one_by_one;
      for (std::size_t n = 0; n < before; ++n) {
        at_once.add(~n);
        one_by_one.add(~n);
      }
      at_once.add_bytes(bytes.data(), size);
      one_by_one.add(size);
      for (const std::uint64_t word : words) one_by_one.add(word);
      EXPECT_EQ(at_once.value(), one_by_one.value()) << size << " after " << before;
    }
  }
}

TEST(WordHasher, DoublesAreHashedByTheirBits) {
  const auto hash_of_double = [](double value) {
    WordHasher hash;
    hash.add(value);
    return hash.value();
  };
  EXPECT_NE(hash_of_double(0.0), hash_of_double(-0.0));
  EXPECT_EQ(hash_of_double(1.5), hash_of_double(1.5));
}

}  // namespace
}  // namespace palpate
