#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "palpate/device/model_change.h"
#include "palpate/server/viewer_host.h"
#include "session/live_model.h"
#include "session/measured_cells.h"
#include "session/preparation_thread.h"
#include "session/session_loop.h"
#include "session/tissue_frames.h"
#include "session/tissue_thread.h"

namespace palpate {

/// Choice of the law of soft tissue, and its solver with a thread.
///
///    choose() ── surfaces and cell size known ──► next model version
///       └─ otherwise: awaited ── prepare(), on the preparation thread ──► next version, or failure
///
/// While a law is awaited the current one stays in effect. Members without a lock of their own are guarded by
/// the model's lock (LiveModel).
class LawChoice final : public PreparedChoice {
 public:
  /// Prepares a model for another law. May throw.
  using Prepare = std::function<Result<MeasuredCells>(const Model& model, TissueLaw law, std::size_t devices,
                                                      const Progress& progress)>;
  /// Starts or wakes the thread that calls prepare().
  using Wake = std::function<Result<void>(const LiveModel::Lock& lock)>;

  /// @param model, loop     outlive this object
  /// @param solve           begins or solves a frame, as TissueFrames::Solve
  /// @param coarser_tissue  warning about the law that the session begins with; see coarser_tissue()
  LawChoice(LiveModel& model, SessionLoop& loop, std::size_t devices, Prepare prepare,
            TissueFrames::Solve solve, Wake wake, const std::string& coarser_tissue);
  ~LawChoice() override { end(); }

  /// Starts the solver if the model's law displaces tissue. Needs a loop.
  /// @param threads  whether solvers have threads; otherwise the caller solves by run_step()
  void begin(bool threads);
  /// Ends the solver; none is started any more.
  void end();

  /// Makes the solver's next step if one is due and it has no thread.
  /// @returns whether another one is due
  bool run_step(TissueFrames::Clock::time_point now);

  /// Errors: those of check_law, and kUnavailable without a thread for the preparation.
  Result<void> choose(const LiveModel::Lock& lock, TissueLaw law, RequestedBy by);
  void choose_by_script(TissueLaw law);
  /// Model version to which the script's last choice led; 0: it failed; empty: it is being prepared.
  std::optional<std::uint32_t> script_version() const;

  /// Fills in the current law, the awaited one, and why the last choice failed or the current law cannot be
  /// solved.
  void describe(const LiveModel::Lock& lock, ViewedState& state) const;
  /// Warning text: the soft tissue of the current law is solved in coarser cells than the scene requests
  /// because this machine is too slow. Empty if it is not.
  std::string coarser_tissue() const;
  /// The same warnings for laws chosen since the session began, in chronological order; after end() also one
  /// about tissue that could not be solved.
  std::vector<std::string> later_warnings() const;
  /// Deformation around a device's tool; null: none. Does not wait for the model's lock.
  std::shared_ptr<const ViewedDeformation> deformation(std::size_t device) const;

  bool is_pending(const LiveModel::Lock& /*held*/) const override { return awaited_.has_value(); }
  void prepare(LiveModel::Lock& lock, const Progress& progress) override;
  void abandon_without_memory(const LiveModel::Lock& lock) noexcept override;

 private:
  // cell size as measured on this machine; factor 0: not measured
  struct CellSize {
    double cell_factor = 0;
    std::string warning;
  };
  CellSize& cell_size_of(TissueLaw law) { return cell_sizes_[static_cast<std::size_t>(law)]; }
  const CellSize& cell_size_of(TissueLaw law) const { return cell_sizes_[static_cast<std::size_t>(law)]; }
  void switch_to(const LiveModel::Lock& lock, const Model& under, double cell_factor, RequestedBy by);
  void abandon(const LiveModel::Lock& lock, Error why);
  void start_solver(const LiveModel::Lock& lock);

  LiveModel& model_;
  SessionLoop& loop_;
  const std::size_t devices_;
  const Prepare prepare_;
  const TissueFrames::Solve solve_;
  const Wake wake_;

  std::optional<TissueLaw> awaited_;
  RequestedBy awaited_by_;
  std::optional<Error> failure_;
  std::optional<std::uint32_t> script_version_;
  std::array<CellSize, ModelChange::kLaws> cell_sizes_;
  std::vector<std::string> later_warnings_;
  bool has_threads_ = true, has_ended_ = false;
  std::unique_ptr<TissueFrames> solver_;
  std::unique_ptr<TissueThread> solver_thread_;
  std::atomic<const TissueFrames*> solver_for_readers_{nullptr};  // solver_, for readers without the lock
};

}  // namespace palpate
