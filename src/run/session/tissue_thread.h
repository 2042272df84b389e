#pragma once

#include <array>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>

#include "palpate/recording/recording.h"
#include "palpate/server/viewer_server.h"
#include "palpate/servo/servo_loop.h"
#include "palpate/tissue/chain_mail.h"
#include "palpate/tissue/yield_solver.h"

namespace palpate {

/// Solves deforming tissue concurrently with a running loop, frame by frame: from the latest tick, for use in
/// the following ticks. Each solution passed to the loop is logged in `told` with the tick that it was solved
/// from, so that a recording replays. A chain mail affects no force and is not logged. A machine that is
/// slower than the frame rate produces fewer frames; if memory runs out, the last frame stays.
class TissueThread {
 public:
  /// @param felt  returns the current model version; called on this thread
  TissueThread(ServoLoop& loop, EventLog& told, std::function<std::shared_ptr<const Model>()> felt);
  ~TissueThread();
  TissueThread(const TissueThread&) = delete;
  TissueThread& operator=(const TissueThread&) = delete;

  /// Deformation around a device's tool in the last frame; null: none. Thread-safe.
  std::shared_ptr<const ViewedYield> yielded(std::size_t device) const;

 private:
  void run();
  void solve_next();
  void rest();
  void move_mail(const Model& model, const TickRecord& felt);
  void show(const TickRecord& felt);

  ServoLoop& loop_;
  EventLog& told_;
  const std::function<std::shared_ptr<const Model>()> felt_;
  YieldSolver solver_;
  ChainMailTissue mail_;
  std::uint32_t mail_frame_ = 0;
  bool any_ = false;
  std::uint64_t last_input_ = 0;
  mutable std::mutex mutex_;  // guards the members below
  std::array<std::shared_ptr<const ViewedYield>, kMaxDevices> shown_;
  bool ending_ = false;
  std::condition_variable ends_;
  std::thread thread_;
};

/// Deformation field around a device's tool under the force with which it pressed in that tick; null if there
/// is none.
std::shared_ptr<const ViewedYield> viewed_yield(const YieldSolver& solver, const TickRecord& felt,
                                                std::size_t device);

}  // namespace palpate
