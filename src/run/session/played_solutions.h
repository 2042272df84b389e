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
#include "palpate/server/viewer_host.h"
#include "palpate/tissue/soft_tissue_solver.h"
#include "palpate/tissue/tissue_laws.h"
#include "session/cut_list.h"
#include "session/solution_index.h"

namespace palpate {

/// Deformation of soft tissue at the displayed position of a recording, solved again on a thread of its own:
///
///    displayed tick ──► number of its solution ──► input ticks of it and of a few before it
///                                                                      │
///    viewers ◄── node displacements ◄── solver, continuing in their boxes ◄┘
///
/// During forward playback each solution continues from the previous one, as in the original run. At another
/// position the solver starts kLeadIn solutions earlier. Thread-safe.
class PlayedSolutions {
 public:
  /// Number of solutions before the requested one from which a new position starts. The first is solved to
  /// convergence, the others with as few iterations as in the run, so that a moving tool meets the same state
  /// as then.
  static constexpr std::size_t kLeadIn = 3;
  /// Largest number of intermediate solutions for which the requested one is continued from the last one.
  static constexpr std::size_t kMaxGap = 8;

  /// Returns the tick in a row of the recording; empty if it cannot be read. Called on the solver's thread.
  using TickAt = std::function<std::optional<TickRecord>(std::uint64_t row, const Progress& progress)>;

  /// @param model  at the beginning of the recording, with the proxy's surfaces
  /// @param cuts   sweeps and stroke changes of the recording
  /// @throws std::system_error  if no thread can be created
  PlayedSolutions(std::shared_ptr<const Model> model, SolutionIndex index, CutList cuts, LawHistory laws,
                  TickAt tick_at);
  ~PlayedSolutions();
  PlayedSolutions(const PlayedSolutions&) = delete;
  PlayedSolutions& operator=(const PlayedSolutions&) = delete;

  /// Requests a solution by its number; 0: none.
  /// @param near  until it is solved, the deformation of another position is shown if that is at most this
  /// many solutions away
  void request(std::uint32_t number, std::uint32_t near);
  /// Deformation around a device's tool at the requested position or near it; null if nothing is deformed, or
  /// nothing is solved yet.
  std::shared_ptr<const ViewedDeformation> deformation(std::size_t device) const;

 private:
  using Shown = std::array<std::shared_ptr<const ViewedDeformation>, kMaxDevices>;

  void run();
  Shown solve(std::uint32_t number);
  std::shared_ptr<const Model> model_of(std::uint32_t version);

  const std::shared_ptr<const Model> model_;
  const SolutionIndex index_;
  const CutList cuts_;
  const LawHistory laws_;
  const TickAt tick_at_;

  // used by the solver's thread only
  SoftTissueSolver solver_;
  std::shared_ptr<const Model> cut_;  // model of the last request
  std::size_t cut_by_ = 0;            // number of sweeps applied to it
  std::vector<std::uint64_t> undone_to_;

  mutable std::mutex mutex_;  // guards the members below
  std::condition_variable changed_;
  std::uint32_t wanted_ = 0, near_ = 0, done_ = 0;
  Shown shown_;

  std::atomic<bool> ending_{false};
  std::thread thread_;
};

}  // namespace palpate
