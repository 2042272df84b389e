#pragma once

#include <array>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>

#include "palpate/link/viewer_server.h"
#include "palpate/recording/recording.h"
#include "palpate/servo/servo_loop.h"
#include "palpate/tissue/chain_mail.h"
#include "palpate/tissue/yield_solver.h"

namespace palpate {

/// Solves tissue that yields beside a running loop, a frame after the other: from the latest tick to the next
/// ones. What the loop is told stands in `told` with the tick that it was solved from, so that a recording
/// replays. Of a chain mail nothing is felt, and nothing told. A machine that is slower than a frame gets
/// fewer of them; where memory runs out, the last one stays.
class TissueThread {
 public:
  /// @param felt  the model that is felt now; asked from the thread
  TissueThread(ServoLoop& loop, EventLog& told, std::function<std::shared_ptr<const Model>()> felt);
  ~TissueThread();
  TissueThread(const TissueThread&) = delete;
  TissueThread& operator=(const TissueThread&) = delete;

  /// How tissue has yielded around a device's tool by the last frame; null: nothing has. Any thread.
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
  mutable std::mutex mutex_;  // of what follows
  std::array<std::shared_ptr<const ViewedYield>, kMaxDevices> shown_;
  bool ending_ = false;
  std::condition_variable ends_;
  std::thread thread_;
};

/// A solver's field around a device's tool under the force with which it pressed in that tick; null: there is
/// none.
std::shared_ptr<const ViewedYield> viewed_yield(const YieldSolver& solver, const TickRecord& felt,
                                                std::size_t device);

}  // namespace palpate
