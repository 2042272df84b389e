#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <type_traits>

#include "palpate/base/cache_line.h"

namespace palpate {

/// Latest value passed from one thread to one other, wait-free on both sides (triple buffer): parameters
/// reach the servo through one. A Snapshot does not suit: its reader retries while the writer is storing, and
/// the servo would spin on a writer that it has itself pre-empted.
///
/// Each of the three slots has exactly one owner at any time:
///
///      writer: back_        middle_ (index, fresh?)        front_ :reader
///        [ 2 ]   ─── post: swap ──►  [ 1 ]  ◄── take: swap ───  [ 0 ]
///
/// - post() fills the back slot and swaps it with the middle one, marking it fresh; take() swaps the front
///   slot with the middle one if that is fresh. A value that was not taken is overwritten by the next post.
/// - The swap is one atomic exchange of a byte, which transfers ownership of both slots.
template <class T>
class Mailbox {
  // a type that owns memory could free or allocate it in the reader
  static_assert(std::is_copy_assignable_v<T> && std::is_trivially_destructible_v<T>);

 public:
  explicit Mailbox(const T& initial = T{}) : slots_{Slot{initial}, Slot{initial}, Slot{initial}} {}
  Mailbox(const Mailbox&) = delete;
  Mailbox& operator=(const Mailbox&) = delete;

  /// Publishes a value. Writer only; wait-free.
  void post(const T& value) noexcept {
    slots_[back_].value = value;
    back_ = middle_.exchange(back_ | kFresh, std::memory_order_acq_rel) & kIndex;
  }

  /// Reads the latest value if one was posted since the last successful take: returns true and sets `value`.
  /// Otherwise returns false and leaves `value` unchanged. Reader only; wait-free.
  bool take(T& value) noexcept {
    if ((middle_.load(std::memory_order_relaxed) & kFresh) == 0) return false;
    front_ = middle_.exchange(front_, std::memory_order_acq_rel) & kIndex;
    value = slots_[front_].value;
    return true;
  }

 private:
  static constexpr std::uint8_t kIndex = 3, kFresh = 4;
  struct alignas(kCacheLine_bytes) Slot {
    T value;
  };

  std::array<Slot, 3> slots_;
  alignas(kCacheLine_bytes) std::uint8_t front_ = 0;
  alignas(kCacheLine_bytes) std::atomic<std::uint8_t> middle_{1};
  alignas(kCacheLine_bytes) std::uint8_t back_ = 2;
};

}  // namespace palpate
