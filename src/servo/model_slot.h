#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

#include "palpate/haptics/haptics.h"

namespace palpate {

/// The model that is felt, replaced while it is being felt. The servo reads a pointer and frees nothing; who
/// replaces a model frees the old one, once no tick can be using it any more.
///
///      set:    held_ += new, current_ = new, retired at = begun_        begun_ ... done_: ticks
///      tick:   ++begun_, use current_, ++done_
///      free:   a retired model once done_ >= the begun_ of its retirement
///
/// A tick that may still use the old model had begun when it was retired; one that begins later sees the new
/// one (both are sequentially consistent).
class ModelSlot {
 public:
  explicit ModelSlot(std::shared_ptr<const Model> model);

  // ---- the servo thread
  const Model& begin_tick() noexcept {
    begun_.fetch_add(1);
    return *current_.load();
  }
  void end_tick() noexcept { done_.fetch_add(1); }

  // ---- every other thread
  /// A model whose version is below the last one's is a bug.
  void set(std::shared_ptr<const Model> model);
  /// Frees what no tick uses; how many models are still held, the current one included.
  std::size_t collect();

 private:
  struct Held {
    std::shared_ptr<const Model> model;
    std::uint64_t free_from;  // ticks that must have ended; the current one's is the largest number
  };
  std::size_t collect_locked();

  std::atomic<const Model*> current_;
  std::atomic<std::uint64_t> begun_{0}, done_{0};
  std::mutex mutex_;
  std::vector<Held> held_;
};

}  // namespace palpate
