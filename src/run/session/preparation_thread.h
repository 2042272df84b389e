#pragma once

#include <atomic>
#include <condition_variable>
#include <thread>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"
#include "session/live_model.h"

namespace palpate {

/// Choice that may need a long preparation before it takes effect.
class PreparedChoice {
 public:
  virtual ~PreparedChoice() = default;
  virtual bool is_pending(const LiveModel::Lock& lock) const = 0;
  /// Carries out or gives up the pending preparation. Called on the thread; unlocks `lock` while it works.
  virtual void prepare(LiveModel::Lock& lock, const Progress& progress) = 0;
  /// Gives up the pending preparation, if there is one, because of an exception. Must not throw.
  virtual void abandon_without_memory(const LiveModel::Lock& lock) noexcept = 0;
};

/// Low-priority thread on which a session prepares methods and laws, one after the other. It is started by
/// the first wake().
class PreparationThread {
 public:
  /// @param model    outlives this object
  /// @param choices  in the order in which they are served; outlive this object
  PreparationThread(LiveModel& model, std::vector<PreparedChoice*> choices)
      : model_(model), choices_(std::move(choices)) {}
  ~PreparationThread() { end(); }
  PreparationThread(const PreparationThread&) = delete;
  PreparationThread& operator=(const PreparationThread&) = delete;

  /// Makes sure that the thread runs and looks for pending choices once `lock` is free.
  /// Errors: kUnavailable if no thread can be created.
  Result<void> wake(const LiveModel::Lock& lock);
  /// Interrupts the preparation in progress and ends the thread.
  void end();

 private:
  void run();
  PreparedChoice* next_pending(const LiveModel::Lock& lock) const;

  LiveModel& model_;
  const std::vector<PreparedChoice*> choices_;
  std::condition_variable woken_;
  std::atomic<bool> ending_{false};
  std::thread thread_;  // started under the model's lock
};

}  // namespace palpate
