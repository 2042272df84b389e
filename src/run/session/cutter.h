#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <thread>
#include <vector>

#include "palpate/device/model_change.h"
#include "palpate/device/sweep_record.h"
#include "palpate/server/viewer_host.h"
#include "palpate/tissue/protected_distance.h"
#include "palpate/tissue/removed_volume.h"
#include "session/cut_list.h"
#include "session/live_model.h"
#include "session/session_loop.h"

namespace palpate {

/// Removes from the model what the burrs of a session sweep, and undoes and redoes strokes.
///
///    loop ── sweeps, a ring ──► run_step() ── carve, without the lock ──► next model version
///    request() ── queue ──────► run_step(), between strokes ────────────► next model version
///
/// Only run_step() cuts, on the cutter's thread or, in a session without threads, between its ticks. A
/// version from which it carves therefore contains every earlier cut. Members are guarded by the model's lock
/// (LiveModel). Invariant while the lock is free: cuts_, removed_ and nearest_ describe the current model
/// version.
class Cutter {
 public:
  /// Undo or redo of the last stroke. It is obsolete once another stroke begins.
  struct StrokeChange {
    StrokeAction action = StrokeAction::kUndo;
    std::uint32_t strokes = 0;  ///< Number of strokes begun when it was requested
  };

  /// @param model, loop  outlive this object
  Cutter(LiveModel& model, SessionLoop& loop);
  ~Cutter() { end(); }
  Cutter(const Cutter&) = delete;
  Cutter& operator=(const Cutter&) = delete;

  using Clock = std::chrono::steady_clock;

  /// Starts the thread if a tool of the model cuts. Needs a loop.
  /// @param threads  whether there is a thread; otherwise the caller cuts by run_step()
  void begin(bool threads);
  void end();
  /// Carves the sweeps that are complete and changes strokes as requested, if that is due and there is no
  /// thread. Takes some milliseconds while a burr cuts.
  void run_step(Clock::time_point now);

  /// Errors: kUsage while the motor runs, if another stroke was begun, and without such a stroke.
  Result<void> check(const LiveModel::Lock& lock, const StrokeChange& change, const Parameters& now) const;
  /// Queues a checked change. It is carried out once all sweeps of the last stroke have been removed.
  void request(const LiveModel::Lock& lock, const StrokeChange& change, RequestedBy by);
  /// Queues a change of the last stroke, with the motor off. Does nothing if there is no such stroke or no
  /// tool cuts.
  void request_by_script(StrokeAction action);
  /// Model version to which the script's last change led; 0: it had no effect; empty: it is queued.
  std::optional<std::uint32_t> script_version() const;

  /// Sweeps in force at a version, as ViewerHost::sweeps.
  std::vector<SweepRecord> sweeps(std::uint32_t version, std::uint64_t first, std::size_t max_count) const;
  /// Fills in the sweeps, the strokes, the removed volume and the distances.
  /// @param nearest_mm  smallest distances over all ticks so far
  void describe(const LiveModel::Lock& lock, const std::map<LabelId, double>& nearest_mm,
                ViewedState& state) const;

 private:
  struct QueuedChange {
    StrokeChange change;
    RequestedBy by;
  };
  void run();
  void cut_and_change() noexcept;
  void cut(std::vector<Cut> cuts);
  void change_strokes();
  std::ptrdiff_t available_strokes(const LiveModel::Lock& lock, StrokeAction action) const;

  LiveModel& model_;
  SessionLoop& loop_;
  const std::shared_ptr<const Model> first_;  // model that the session began with, for its tools

  CutList cuts_;                    // sweeps and stroke changes of the model
  RemovedVolume removed_;           // volume removed by them
  ProtectedDistanceMeter nearest_;  // their distance to structures
  std::deque<QueuedChange> queued_;
  std::optional<std::uint32_t> script_version_;

  std::vector<Cut> taken_;  // from the loop, and not carved yet
  Clock::time_point due_{};
  std::atomic<bool> ending_{false};
  std::thread thread_;
};

}  // namespace palpate
