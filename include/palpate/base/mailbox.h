#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <type_traits>

#include "palpate/base/cache_line.h"

namespace palpate {

/// The latest value from one thread to one other, where neither may ever wait: parameters come into the servo
/// through one. A Snapshot will not do there: its reader tries again while the writer is in the middle, and
/// the servo would spin on a writer that it has itself pre-empted.
///
/// Three slots, and every one has one owner at any time:
///
///      writer: back_        middle_ (index, fresh?)        front_ :reader
///        [ 2 ]   ─── post: swap ──►  [ 1 ]  ◄── take: swap ───  [ 0 ]
///
/// - post() fills the back slot and swaps it for the middle one, marking it fresh; take() swaps the front
///   slot for the middle one when that is fresh. A post that was not taken is overwritten by the next.
/// - The swap is one atomic exchange of a byte: it hands one slot over and takes the other.
template <class T>
class Mailbox {
  // what owns memory could free or allocate it in the reader
  static_assert(std::is_copy_assignable_v<T> && std::is_trivially_destructible_v<T>);

 public:
  explicit Mailbox(const T& initial = T{}) : slots_{Slot{initial}, Slot{initial}, Slot{initial}} {}
  Mailbox(const Mailbox&) = delete;
  Mailbox& operator=(const Mailbox&) = delete;

  /// The one writer only. Wait-free.
  void post(const T& value) noexcept {
    slots_[back_].value = value;
    back_ = middle_.exchange(back_ | kFresh, std::memory_order_acq_rel) & kIndex;
  }

  /// The one reader only. True, and the latest value, when something was posted since the last take that gave
  /// something; otherwise false and `value` unchanged. Wait-free.
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
