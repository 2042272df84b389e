#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>

#include "palpate/recording/recording.h"
#include "palpate/server/viewer_host.h"
#include "palpate/servo/servo_loop.h"
#include "palpate/tissue/chain_mail.h"
#include "palpate/tissue/soft_tissue_solver.h"

namespace palpate {

/// Solves deforming tissue concurrently with a running loop, frame by frame: from the latest tick, for use in
/// the following ticks. Each solution passed to the loop is logged in `log` with the tick that it was solved
/// from, so that a recording replays. A chain mail affects no force and is not logged. A machine that is
/// slower than the frame rate produces fewer frames.
///
/// If memory runs out, the loop gets a frame without known spots, so that tissue renders as a half-space of
/// its own modulus (blend_compliance): the last solution would be extrapolated ever farther from the point
/// for which it holds. Deformation is shown at rest. The solver is reset and retries every kRetry.
class TissueThread {
 public:
  static constexpr std::chrono::seconds kRetry{1};
  /// Solves the next frame. May throw std::bad_alloc.
  using Solve = std::function<void(SoftTissueSolver& solver, const Model& model, const TickRecord& tick)>;

  /// @param model   returns the current model version; called on this thread
  /// @param solve  replaced in tests only
  TissueThread(ServoLoop& loop, EventLog& log, std::function<std::shared_ptr<const Model>()> model,
               Solve solve);
  ~TissueThread();
  TissueThread(const TissueThread&) = delete;
  TissueThread& operator=(const TissueThread&) = delete;

  /// Deformation around a device's tool in the last frame; null: none. Thread-safe.
  std::shared_ptr<const ViewedDeformation> deformation(std::size_t device) const;
  /// Whether memory ran out in the latest attempt. Thread-safe.
  bool is_out_of_memory() const { return is_out_of_memory_; }
  /// Number of times that memory ran out after an attempt that succeeded. Thread-safe.
  int failures() const { return failures_; }

 private:
  void run();
  void solve_next();
  void publish_unsolved();
  void start_afresh() noexcept;
  void rest();
  void move_mail(const Model& model, const TickRecord& tick);
  void show(const TickRecord& tick);

  ServoLoop& loop_;
  EventLog& log_;
  const std::function<std::shared_ptr<const Model>()> model_;
  const Solve solve_;
  SoftTissueSolver solver_;
  std::uint32_t published_ = 0;  // number of the last frame passed to the loop
  std::optional<ChainMailTissue> mail_{std::in_place};
  std::uint32_t mail_frame_ = 0;
  bool any_ = false;
  std::uint64_t last_input_ = 0;
  std::atomic<bool> is_out_of_memory_{false};
  std::atomic<int> failures_{0};
  mutable std::mutex mutex_;  // guards the members below
  std::array<std::shared_ptr<const ViewedDeformation>, kMaxDevices> shown_;
  bool ending_ = false;
  std::condition_variable ends_;
  std::thread thread_;
};

/// Default of TissueThread::Solve: SoftTissueSolver::solve.
void solve_tissue_frame(SoftTissueSolver& solver, const Model& model, const TickRecord& tick);

/// Deformation field around a device's tool under the force with which it pressed in that tick; null if there
/// is none.
std::shared_ptr<const ViewedDeformation> viewed_deformation(const SoftTissueSolver& solver,
                                                            const TickRecord& tick, std::size_t device);

}  // namespace palpate
