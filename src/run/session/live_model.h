#pragma once

#include <cstddef>
#include <memory>
#include <mutex>
#include <span>

#include "palpate/device/model_change.h"
#include "palpate/model/changed_model.h"
#include "palpate/recording/recording.h"
#include "palpate/server/viewer_host.h"
#include "session/session_loop.h"

namespace palpate {

/// Current version of a running session's model, and the lock under which the session changes.
///
///    edit of a tissue ─┐
///    method, law ──────┼─ apply(), under the lock ──► loop, log ──► versions()
///    cut, stroke ──────┘
///
/// Invariant while the lock is free: versions().current is the model that was passed to the loop last, and
/// the log contains every change that led to it. The same lock serialises everything whose outcome depends on
/// the model: MethodChoice, LawChoice and Cutter guard their own members by it, so that a request is checked
/// and carried out on one state. A Lock passed as an argument is the proof that the caller holds it. No
/// thread holds it while it builds surfaces, generates fields or carves; nothing is locked before it except
/// StopSwitch, which never waits for it.
class LiveModel {
 public:
  using Lock = std::unique_lock<std::mutex>;

  /// @param model  version that the loop starts with
  /// @param loop   outlives this object
  LiveModel(std::shared_ptr<const Model> model, SessionLoop& loop) : loop_(loop), versions_{model, model} {}

  Lock lock() const { return Lock(mutex_); }
  Lock try_lock() const { return Lock(mutex_, std::try_to_lock); }

  const ModelVersions& versions(const Lock& /*held*/) const { return versions_; }
  const Model& current(const Lock& /*held*/) const { return *versions_.current; }

  /// Passes the next version to the loop. Strong exception guarantee: either the loop and versions() change,
  /// or neither does. Needs a loop, as the following two do.
  void apply(const Lock& lock, ModelVersions next, const ModelChange& change, RequestedBy by);
  /// The same for a version that differs from the current one by cuts.
  void apply_cuts(const Lock& lock, std::span<const Cut> cuts, std::shared_ptr<const Model> next);
  /// Replaces the current version by the same one prepared for further methods, which is not a change of it.
  void set_prepared(const Lock& lock, ModelVersions same);

  /// Change that results from a viewer's edit of a tissue; it may be empty.
  /// @param method  current force method: a direct one cannot render other stiffnesses
  /// Errors: those of changed_model; kBadInput and kUsage for an edit that this session cannot render.
  Result<ModelChange> check(const Lock& lock, const TissueRequest& request, ForceMethod method) const;
  /// Carries out a checked, non-empty change of a tissue. Errors: those of changed_model.
  Result<void> edit(const Lock& lock, const ModelChange& change, RequestedBy by);

  /// Stiffness that a tick rendered at a device's contact point. The proxy scales each tissue by itself; a
  /// direct method scales all tissues by one factor. 0: no contact.
  double rendered_stiffness_N_per_mm(const Lock& lock, const TickRecord& tick, std::size_t device) const;

 private:
  SessionLoop& loop_;
  mutable std::mutex mutex_;
  ModelVersions versions_;
};

}  // namespace palpate
