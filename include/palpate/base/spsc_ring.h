#pragma once

#include <algorithm>
#include <atomic>
#include <bit>
#include <cstddef>
#include <cstring>
#include <memory>
#include <span>
#include <type_traits>

#include "palpate/base/cache_line.h"

namespace palpate {

/// A queue of fixed length from one thread to another, neither of which ever waits: every tick goes from the
/// servo to the recorder through one.
///
/// The servo must not allocate, lock or wait for a slow disk. So the room is taken in advance and its pages
/// touched, and a full ring refuses: the servo counts the loss and goes on.
///
///      slots    [ . . a b c d . . ]        size a power of two, index & mask_
///                     ^       ^
///                   head_   tail_          both only ever grow; tail_ - head_ is the size
///                 consumer  producer
///
/// - Only the producer writes tail_, only the consumer head_.
/// - Slots in [head_, tail_) are the consumer's, the others the producer's. The release store of an index
///   hands slots over, the acquire load of it takes them.
/// - Each index shares its cache line with its owner's last sight of the other one, so that most operations
///   touch no line that the other thread writes: the other's index is only read again when the ring looks
///   full (or empty) by the last sight of it. A stale sight is never wrong, only pessimistic.
template <class T>
class SpscRing {
  static_assert(std::is_trivially_copyable_v<T>);

 public:
  /// Room for `at_least` items, rounded up to a power of two. Allocates and writes every slot, so that push()
  /// and pop() meet no page fault.
  explicit SpscRing(std::size_t at_least)
      : mask_(std::bit_ceil(std::max<std::size_t>(at_least, 1)) - 1),
        slots_(std::make_unique<T[]>(mask_ + 1)) {}

  /// Producer only. False, and nothing done, when the ring is full. Wait-free.
  /// @param bytes  only so much of the item's beginning is copied; the rest of the slot stays as it was
  bool push(const T& item, std::size_t bytes = sizeof(T)) noexcept {
    const std::size_t tail = tail_.load(std::memory_order_relaxed);
    if (tail - head_seen_ > mask_) {
      head_seen_ = head_.load(std::memory_order_acquire);
      if (tail - head_seen_ > mask_) return false;
    }
    std::memcpy(static_cast<void*>(&slots_[tail & mask_]), &item, bytes);
    tail_.store(tail + 1, std::memory_order_release);
    return true;
  }

  /// Consumer only. Fills the front of `out` with the oldest items, in order; returns how many. Wait-free.
  std::size_t pop(std::span<T> out) noexcept {
    const std::size_t head = head_.load(std::memory_order_relaxed);
    if (tail_seen_ - head < out.size()) tail_seen_ = tail_.load(std::memory_order_acquire);
    const std::size_t count = std::min(out.size(), tail_seen_ - head);

    // up to the end of the slots, then on from their beginning
    const std::size_t first = std::min(count, capacity() - (head & mask_));
    std::copy_n(slots_.get() + (head & mask_), first, out.data());
    std::copy_n(slots_.get(), count - first, out.data() + first);
    head_.store(head + count, std::memory_order_release);
    return count;
  }

  /// Items inside, 0 ... capacity(). From any thread; already past when it is read.
  std::size_t size() const noexcept {
    const std::size_t head = head_.load(std::memory_order_acquire);
    return std::min(tail_.load(std::memory_order_acquire) - head, capacity());
  }
  std::size_t capacity() const noexcept { return mask_ + 1; }

 private:
  const std::size_t mask_;
  const std::unique_ptr<T[]> slots_;
  // the producer's line
  alignas(kCacheLine_bytes) std::atomic<std::size_t> tail_{0};
  std::size_t head_seen_ = 0;
  // the consumer's line
  alignas(kCacheLine_bytes) std::atomic<std::size_t> head_{0};
  std::size_t tail_seen_ = 0;
};

}  // namespace palpate
