#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>
#include <cstring>
#include <thread>
#include <type_traits>

#include "palpate/base/cache_line.h"

namespace palpate {

/// Latest value of one writer, for any number of readers: viewers, publishers and soft tissue read the
/// servo's last tick through one.
///
/// The writer is the servo and must never wait, not even for a reader that is slow, stopped in a debugger or
/// killed half-way. Readers therefore write nothing: they copy, and check afterwards whether a store
/// overlapped the copy (a sequence lock):
///
///      sequence_   4         5  (odd: being written)        6
///      words_      old old | new old -> new new ->        | new new
///      reader      even? copy ........................ same as before? if not, retry
///
/// - Only the writer writes. sequence_ is odd exactly while the words are being replaced.
/// - The words are atomics: a reader may read them while they change, which for plain memory would be
///   undefined behaviour even though the copy is discarded. Each word is stored with release and loaded with
///   acquire, so that a reader that sees one new word also sees the odd sequence number and retries.
///   On x86-64 these are plain moves. (Boehm, "Can seqlocks get along with programming language memory
///   models?", MSPC 2012, also shows relaxed words between fences; ThreadSanitizer does not support fences.)
/// - No pointers and no locks: it can be placed in memory shared between processes.
template <class T>
class Snapshot {
  static_assert(std::is_trivially_copyable_v<T>);
  static_assert(std::atomic<std::uint64_t>::is_always_lock_free);

 public:
  explicit Snapshot(const T& initial = T{}) noexcept { write_words(initial, sizeof(T)); }
  Snapshot(const Snapshot&) = delete;
  Snapshot& operator=(const Snapshot&) = delete;

  /// Publishes a value. Writer only; wait-free, independently of readers.
  /// @param bytes  number of leading bytes of the value to store; the rest is unchanged
  void store(const T& value, std::size_t bytes = sizeof(T)) noexcept {
    const std::uint64_t sequence = sequence_.load(std::memory_order_relaxed);
    sequence_.store(sequence + 1, std::memory_order_relaxed);
    write_words(value, bytes);
    sequence_.store(sequence + 2, std::memory_order_release);
  }

  /// Latest value. Retries until no store overlaps the copy, yielding to other threads after a while; a
  /// reader must not have a higher real-time priority than the writer.
  T load() const {
    T value;
    for (int tries = 1; !try_load(value); ++tries)
      if (tries % kTriesBetweenYields == 0) std::this_thread::yield();
    return value;
  }

  /// One attempt: returns false and leaves `value` unchanged if a store overlapped the copy.
  bool try_load(T& value) const noexcept {
    const std::uint64_t before = sequence_.load(std::memory_order_acquire);
    if (before % 2 == 1) return false;
    std::array<std::uint64_t, kWords> copy;
    for (std::size_t i = 0; i < kWords; ++i) copy[i] = words_[i].load(std::memory_order_acquire);
    if (sequence_.load(std::memory_order_relaxed) != before) return false;
    std::memcpy(static_cast<void*>(&value), copy.data(), sizeof(T));
    return true;
  }

  /// Number of completed stores.
  std::uint64_t version() const noexcept { return sequence_.load(std::memory_order_acquire) / 2; }

 private:
  static constexpr std::size_t kWords = (sizeof(T) + 7) / 8;
  static constexpr int kTriesBetweenYields = 64;

  void write_words(const T& value, std::size_t size) noexcept {
    const auto* bytes = reinterpret_cast<const unsigned char*>(&value);
    for (std::size_t i = 0; 8 * i < size; ++i) {
      std::uint64_t word = 0;
      std::memcpy(&word, bytes + 8 * i, std::min<std::size_t>(8, sizeof(T) - 8 * i));
      words_[i].store(word, std::memory_order_release);
    }
  }

  alignas(kCacheLine_bytes) std::atomic<std::uint64_t> sequence_{0};
  std::array<std::atomic<std::uint64_t>, kWords> words_;
};

}  // namespace palpate
