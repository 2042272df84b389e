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

/// Queue of fixed capacity from one producer thread to one consumer thread, wait-free on both sides: the
/// servo sends every tick to the recorder through one.
///
/// The servo must not allocate, lock or wait for a slow disk. All slots are therefore allocated and their
/// pages touched in advance, and a full ring rejects the item: the servo counts the loss and continues.
///
///      slots    [ . . a b c d . . ]        size a power of two, index & mask_
///                     ^       ^
///                   head_   tail_          both only increase; tail_ - head_ is the size
///                 consumer  producer
///
/// - Only the producer writes tail_, only the consumer writes head_.
/// - Slots in [head_, tail_) belong to the consumer, the others to the producer. The release store of an
///   index transfers slots, the acquire load of it receives them.
/// - Each index shares its cache line with its owner's cached copy of the other index, so that most
///   operations touch no line that the other thread writes: the other index is reloaded only when the ring
///   appears full (or empty) by the cached copy. A stale copy is never wrong, only pessimistic.
template <class T>
class SpscRing {
  static_assert(std::is_trivially_copyable_v<T>);

 public:
  /// Allocates at least `at_least` slots, rounded up to a power of two, and writes every slot, so that push()
  /// and pop() cause no page fault.
  explicit SpscRing(std::size_t at_least)
      : mask_(std::bit_ceil(std::max<std::size_t>(at_least, 1)) - 1),
        slots_(std::make_unique<T[]>(mask_ + 1)) {}

  /// Appends an item. Returns false, with no effect, if the ring is full. Producer only; wait-free.
  /// @param bytes  number of leading bytes of the item to copy; the rest of the slot is unchanged
  bool push(const T& item, std::size_t bytes = sizeof(T)) noexcept {
    const std::size_t tail = tail_.load(std::memory_order_relaxed);
    if (tail - cached_head_ > mask_) {
      cached_head_ = head_.load(std::memory_order_acquire);
      if (tail - cached_head_ > mask_) return false;
    }
    std::memcpy(static_cast<void*>(&slots_[tail & mask_]), &item, bytes);
    tail_.store(tail + 1, std::memory_order_release);
    return true;
  }

  /// Moves the oldest items, in order, to the front of `out`; returns their number. Consumer only; wait-free.
  std::size_t pop(std::span<T> out) noexcept {
    const std::size_t head = head_.load(std::memory_order_relaxed);
    if (cached_tail_ - head < out.size()) cached_tail_ = tail_.load(std::memory_order_acquire);
    const std::size_t count = std::min(out.size(), cached_tail_ - head);

    // up to the end of the slots, then wrapping around to their beginning
    const std::size_t first = std::min(count, capacity() - (head & mask_));
    std::copy_n(slots_.get() + (head & mask_), first, out.data());
    std::copy_n(slots_.get(), count - first, out.data() + first);
    head_.store(head + count, std::memory_order_release);
    return count;
  }

  /// Number of queued items, 0 ... capacity(). From any thread; may be out of date when it is returned.
  std::size_t size() const noexcept {
    const std::size_t head = head_.load(std::memory_order_acquire);
    return std::min(tail_.load(std::memory_order_acquire) - head, capacity());
  }
  std::size_t capacity() const noexcept { return mask_ + 1; }

 private:
  const std::size_t mask_;
  const std::unique_ptr<T[]> slots_;
  // producer's cache line
  alignas(kCacheLine_bytes) std::atomic<std::size_t> tail_{0};
  std::size_t cached_head_ = 0;
  // consumer's cache line
  alignas(kCacheLine_bytes) std::atomic<std::size_t> head_{0};
  std::size_t cached_tail_ = 0;
};

}  // namespace palpate
