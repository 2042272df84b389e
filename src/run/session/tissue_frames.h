#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>

#include "palpate/recording/event_log.h"
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
/// A frame is solved in steps, by TissueThread or, in a session without threads, between its ticks
/// (LiveSession::run_step()).
///
/// If memory runs out, the loop gets a frame without known local compliances, so that tissue renders as a
/// half-space of its own modulus (blend_compliance): the last solution would be extrapolated ever farther
/// from the point for which it holds. Deformation is shown at rest. The solver is reset and retries every
/// kRetry.
class TissueFrames {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::seconds kRetry{1};
  /// Begins the next frame, or solves all of it. May throw std::bad_alloc.
  using Solve = std::function<void(SoftTissueSolver& solver, const Model& model, const TickRecord& tick)>;

  /// @param model  returns the current model version; called by run_step()
  /// @param solve  replaced in tests only
  TissueFrames(ServoLoop& loop, EventLog& log, std::function<std::shared_ptr<const Model>()> model,
               Solve solve);
  TissueFrames(const TissueFrames&) = delete;
  TissueFrames& operator=(const TissueFrames&) = delete;

  /// Time at which the next step is due: at once while a frame is being solved, otherwise the beginning of
  /// the next frame. To be called, like run_step(), only by the thread that makes the steps.
  Clock::time_point due() const { return due_; }
  /// Makes the next step, whether or not it is due: begins a frame, or continues it
  /// (SoftTissueSolver::step()).
  void run_step(Clock::time_point now);

  /// Deformation around a device's tool in the last frame; null: none. Thread-safe.
  std::shared_ptr<const ViewedDeformation> deformation(std::size_t device) const;
  /// Whether memory ran out in the latest attempt. Thread-safe.
  bool is_out_of_memory() const { return is_out_of_memory_; }
  /// Number of times that memory ran out after an attempt that succeeded. Thread-safe.
  int failures() const { return failures_; }

 private:
  /// Model and tick of a frame that is being solved.
  struct Input {
    std::shared_ptr<const Model> model;
    TickRecord tick;
  };
  void begin_frame();
  void finish_frame();
  void publish_unsolved();
  void start_afresh() noexcept;
  void rest();
  void move_mail(const Model& model, const TickRecord& tick);
  void show(const TickRecord& tick);

  ServoLoop& loop_;
  EventLog& log_;
  const std::function<std::shared_ptr<const Model>()> model_;
  const Solve solve_;
  Clock::time_point due_ = Clock::now(), begun_ = due_;
  SoftTissueSolver solver_;
  std::optional<Input> in_progress_;
  std::uint32_t published_ = 0;  // number of the last frame passed to the loop
  std::optional<ChainMailTissue> mail_{std::in_place};
  std::uint32_t mail_frame_ = 0;
  bool has_input_ = false;
  std::uint64_t last_input_ = 0;
  std::atomic<bool> is_out_of_memory_{false};
  std::atomic<int> failures_{0};
  mutable std::mutex mutex_;  // guards shown_
  std::array<std::shared_ptr<const ViewedDeformation>, kMaxDevices> shown_;
};

/// Default of TissueFrames::Solve: SoftTissueSolver::begin_frame().
void begin_tissue_frame(SoftTissueSolver& solver, const Model& model, const TickRecord& tick);

/// Deformation field around a device's tool under the force with which it pressed in that tick; null if there
/// is none.
std::shared_ptr<const ViewedDeformation> viewed_deformation(const SoftTissueSolver& solver,
                                                            const TickRecord& tick, std::size_t device);

}  // namespace palpate
