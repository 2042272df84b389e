#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/contact/model.h"

namespace palpate {

/// Holds the current model and replaces it while the servo uses it (a form of epoch-based reclamation). The
/// servo only loads a pointer and frees nothing. The thread that replaces a model frees the old one once no
/// tick can be using it.
///
///      set:    retired_ += new, current_ = new, retired at = begun_        begun_ ... done_: ticks
///      tick:   ++begun_, use current_, ++done_
///      free:   a retired model once done_ >= the begun_ of its retirement
///
/// A tick that may still use the old model had begun when the model was retired; a tick that begins later
/// loads the new one (both operations are sequentially consistent).
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
  /// Replaces the current model. Errors: kBadInput if it is null or of a version below the current one's.
  Result<void> set(std::shared_ptr<const Model> model);
  /// Frees the models that no tick uses. Returns the number of models still held, the current one included.
  std::size_t collect();

 private:
  struct Retired {
    std::shared_ptr<const Model> model;
    std::uint64_t free_from;  // value of done_ from which it may be freed; maximum for the current model
  };
  std::size_t collect_locked();

  std::atomic<const Model*> current_;
  std::atomic<std::uint64_t> begun_{0}, done_{0};
  std::mutex mutex_;
  std::vector<Retired> retired_;
};

}  // namespace palpate
