#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <span>

namespace palpate {

/// A 64-bit hash that is the same on every build and machine of one byte order; not for security.
/// A rotation, a multiplication and a shift for every eight bytes, finished by the murmur3 avalanche.
/// The shift matters: without it flips of two bits in neighbouring words cancel.
inline constexpr std::uint64_t kHashSeed = 0x9e3779b97f4a7c15ull;

inline void hash_word(std::uint64_t& hash, std::uint64_t word) {
  hash = std::rotl(hash ^ word, 27) * 0x9fb21c651e98df25ull + 0x52dce729ull;
  hash ^= hash >> 32;
}
/// Hashes the bits of a double; -0.0 and 0.0 differ, every NaN is its own bits.
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
/// hash_bytes of bytes that come piece by piece.
class HashOfPieces {
 public:
  explicit HashOfPieces(std::uint64_t& hash) : hash_(hash) {}
  void add(const void* data, std::size_t size) {
    const auto* bytes = static_cast<const unsigned char*>(data);
    if (size == 0) return;
    if (held_ > 0) {
      const std::size_t more = size < 8 - held_ ? size : 8 - held_;
      std::memcpy(reinterpret_cast<unsigned char*>(&word_) + held_, bytes, more);
      held_ += more;
      bytes += more;
      size -= more;
      if (held_ < 8) return;
      take();
    }
    for (; size >= 8; size -= 8, bytes += 8) {
      std::memcpy(&word_, bytes, 8);
      take();
    }
    std::memcpy(&word_, bytes, size);
    held_ = size;
  }
  /// After the last piece.
  void finish() { hash_word(hash_, word_ ^ (static_cast<std::uint64_t>(held_) << 56)); }

 private:
  void take() {
    hash_word(hash_, word_);
    word_ = 0;
    held_ = 0;
  }

  std::uint64_t& hash_;
  std::uint64_t word_ = 0;  // of bytes that make no whole word yet
  std::size_t held_ = 0;
};
inline std::uint64_t hash_finish(std::uint64_t hash) {
  hash ^= hash >> 33;
  hash *= 0xff51afd7ed558ccdull;
  hash ^= hash >> 33;
  hash *= 0xc4ceb9fe1a85ec53ull;
  hash ^= hash >> 33;
  return hash;
}
/// Of words one after the other, for a tick that has some hundreds of them. A step of hash_word() waits for
/// the one before: here every eighth word goes into the same chain, and a processor works on all chains at
/// once.
class HashOfWords {
 public:
  HashOfWords() {
    // no two begin alike
    for (std::size_t n = 0; n < kChains; ++n) chain_[n] = kHashSeed + n;
  }
  void add_word(std::uint64_t word) { hash_word(chain_[count_++ % kChains], word); }
  void add_double(double value) { add_word(std::bit_cast<std::uint64_t>(value)); }
  std::uint64_t value() const {
    std::uint64_t hash = kHashSeed;
    hash_word(hash, count_);
    for (const std::uint64_t chain : chain_) hash_word(hash, chain);
    return hash_finish(hash);
  }

 private:
  static constexpr std::size_t kChains = 8;
  std::array<std::uint64_t, kChains> chain_;
  std::uint64_t count_ = 0;
};

}  // namespace palpate
