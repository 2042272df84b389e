#pragma once

#include <array>
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>

#include "palpate/base/progress.h"
#include "palpate/link/viewer_server.h"
#include "palpate/tissue/tissue_laws.h"
#include "palpate/tissue/yield_solver.h"
#include "session/cut_list.h"
#include "session/yield_index.h"

namespace palpate {

/// How tissue has yielded at the place of a recording that is shown, solved again by a thread of its own:
///
///     tick that is shown ──► number of its solution ──► ticks that it and a few before were solved from
///                                                                              │
///     viewers ◄── where nodes went ◄── a solver that goes on in their boxes ◄──┘
///
/// Where it is played forwards every solution follows from the one before, as in the run. At another place it
/// begins kLeadIn solutions earlier. Any thread.
class PlayedYields {
 public:
  /// Solutions before the one that is wanted, with which a new place begins: the first is solved to its end,
  /// the others by as little as in the run, so that a tool on its way is met as it was then.
  static constexpr std::size_t kLeadIn = 3;
  /// With no more solutions between, the one that is wanted follows from the last one.
  static constexpr std::size_t kMostOn = 8;

  /// The tick in a row of the recording; nothing where it cannot be read. On the thread of the solver.
  using TickAt = std::function<std::optional<TickRecord>(std::uint64_t row, const Progress& progress)>;

  /// @param model  as the recording began with, with the proxy's surfaces
  /// @param cuts   what became of it
  /// @throws std::system_error  there is no thread to be had
  PlayedYields(std::shared_ptr<const Model> model, YieldIndex index, CutList cuts, LawsByVersion laws,
               TickAt tick_at);
  ~PlayedYields();
  PlayedYields(const PlayedYields&) = delete;
  PlayedYields& operator=(const PlayedYields&) = delete;

  /// What is to be solved: a solution's number, 0 none.
  /// @param near  of another place no farther away than so many solutions is shown what yielded there until
  ///              this one is solved
  void want(std::uint32_t number, std::uint32_t near);
  /// Around a device's tool, at the place that is wanted or near it; null: nothing has yielded, or it is not
  /// known yet.
  std::shared_ptr<const ViewedYield> yielded(std::size_t device) const;

 private:
  using Shown = std::array<std::shared_ptr<const ViewedYield>, kMaxDevices>;

  void run();
  Shown solve(std::uint32_t number);
  std::shared_ptr<const Model> model_of(std::uint32_t version);

  const std::shared_ptr<const Model> model_;
  const YieldIndex index_;
  const CutList cuts_;
  const LawsByVersion laws_;
  const TickAt tick_at_;

  // of the thread
  YieldSolver solver_;
  std::shared_ptr<const Model> cut_;  // the last that was asked for
  std::size_t cut_by_ = 0;            // sweeps
  std::vector<std::uint64_t> undone_to_;

  mutable std::mutex mutex_;  // of what follows
  std::condition_variable changed_;
  std::uint32_t wanted_ = 0, near_ = 0, done_ = 0;
  Shown shown_;

  std::atomic<bool> ending_{false};
  std::thread thread_;
};

}  // namespace palpate
