#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>

namespace palpate {

/// 64-bit non-cryptographic hash, identical for every build and machine of the same byte order. Each eight
/// bytes take a rotation, a multiplication and a shift; hash_finish() applies the murmur3 avalanche. Without
/// the shift, flips of two bits in neighbouring words cancel.
inline constexpr std::uint64_t kHashSeed = 0x9e3779b97f4a7c15ull;

inline void hash_word(std::uint64_t& hash, std::uint64_t word) {
  hash = std::rotl(hash ^ word, 27) * 0x9fb21c651e98df25ull + 0x52dce729ull;
  hash ^= hash >> 32;
}
/// Hashes the bits of a double: -0.0 and 0.0 differ, and so do NaNs with different payloads.
inline void hash_double(std::uint64_t& hash, double value) {
  hash_word(hash, std::bit_cast<std::uint64_t>(value));
}
inline void hash_bytes(std::uint64_t& hash, const void* data, std::size_t size) {
  const auto* bytes = static_cast<const unsigned char*>(data);
  for (; size >= 8; size -= 8, bytes += 8) {
    std::uint64_t word;
    std::memcpy(&word, bytes, 8);
    hash_word(hash, word);
  }
  std::uint64_t tail = 0;
  std::memcpy(&tail, bytes, size);
  hash_word(hash, tail ^ (static_cast<std::uint64_t>(size) << 56));
}
inline std::uint64_t hash_finish(std::uint64_t hash) {
  hash ^= hash >> 33;
  hash *= 0xff51afd7ed558ccdull;
  hash ^= hash >> 33;
  hash *= 0xc4ceb9fe1a85ec53ull;
  hash ^= hash >> 33;
  return hash;
}
/// Hash of a sequence of words, for a tick that hashes some hundreds of them. Each step of hash_word()
/// depends on the previous one; here words are buffered and then multiplied in pairs into four independent
/// chains, which a processor executes in parallel. Two words are folded into a chain as in wyhash (Wang Yi,
/// 2019): the high half of a 128-bit product XOR its low half.
class WordHasher {
 public:
  // buffer_ is not initialised: every word is written before it is read.
  WordHasher() {
    // a different seed for each chain
    for (std::size_t n = 0; n < kChains; ++n) chain_[n] = kHashSeed * (2 * n + 1);
  }
  /// Appends words, and doubles by their bits. One call with several words costs less than one call for each.
  template <class... Words>
  void add(Words... words) {
    static_assert(sizeof...(words) <= kBufferedWords - kWordsPerRound);
    if (buffered_ > kBufferedWords - sizeof...(words)) fold();
    std::uint64_t* next = buffer_.data() + buffered_;
    ((*next++ = word_of(words)), ...);
    buffered_ += sizeof...(words);
  }
  /// Appends the size, then the bytes as words of eight bytes, the last one padded with zeros.
  void add_bytes(const void* data, std::size_t size) {
    add(size);
    const auto* bytes = static_cast<const unsigned char*>(data);
    while (size > 0) {
      if (buffered_ == kBufferedWords) fold();
      const std::size_t count = std::min(kBufferedWords - buffered_, (size + 7) / 8),
                        taken = std::min(size, 8 * count);
      buffer_[buffered_ + count - 1] = 0;
      std::memcpy(buffer_.data() + buffered_, bytes, taken);
      buffered_ += count;
      bytes += taken;
      size -= taken;
    }
  }
  /// Hash of everything added; nothing may be added afterwards.
  std::uint64_t value() {
    const std::uint64_t count = count_ + buffered_;
    fold();
    // the remaining words, padded with zeros
    while (buffered_ > 0 && buffered_ < kWordsPerRound) buffer_[buffered_++] = 0;
    fold();
    std::uint64_t hash = kHashSeed;
    hash_word(hash, count);
    for (const std::uint64_t chain : chain_) hash_word(hash, chain);
    return hash_finish(hash);
  }

 private:
  static constexpr std::size_t kChains = 4, kWordsPerRound = 2 * kChains,
                               kBufferedWords = 32 * kWordsPerRound;
  static constexpr std::array<std::uint64_t, kChains> kSecret{0xa0761d6478bd642full, 0xe7037ed1a0b428dbull,
                                                              0x8ebc6af09c88c6e3ull, 0x589965cc75374cc3ull};

  static std::uint64_t folded_product(std::uint64_t a, std::uint64_t b) {
    __extension__ using Wide = unsigned __int128;
    const Wide product = static_cast<Wide>(a) * b;
    return static_cast<std::uint64_t>(product >> 64) ^ static_cast<std::uint64_t>(product);
  }
  static std::uint64_t word_of(double value) { return std::bit_cast<std::uint64_t>(value); }
  template <std::integral Word>
  static std::uint64_t word_of(Word word) {
    return static_cast<std::uint64_t>(word);
  }
  // mixes the buffered words into the chains, kWordsPerRound at a time; fewer than kWordsPerRound remain
  void fold() {
    if (buffered_ < kWordsPerRound) return;
    std::array<std::uint64_t, kChains> chain = chain_;
    std::size_t first = 0;
    for (; first + kWordsPerRound <= buffered_; first += kWordsPerRound)
      for (std::size_t n = 0; n < kChains; ++n)
        chain[n] = folded_product(buffer_[first + n] ^ kSecret[n], buffer_[first + kChains + n] ^ chain[n]);
    chain_ = chain;
    count_ += first;
    std::copy(buffer_.begin() + static_cast<std::ptrdiff_t>(first),
              buffer_.begin() + static_cast<std::ptrdiff_t>(buffered_), buffer_.begin());
    buffered_ -= first;
  }

  std::array<std::uint64_t, kBufferedWords> buffer_;
  std::array<std::uint64_t, kChains> chain_;
  std::size_t buffered_ = 0;
  std::uint64_t count_ = 0;
};

}  // namespace palpate
