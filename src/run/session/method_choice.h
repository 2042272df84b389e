#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>

#include "palpate/server/viewer_host.h"
#include "session/live_model.h"
#include "session/preparation_thread.h"
#include "session/session_loop.h"

namespace palpate {

/// Choice of the force method.
///
///    choose() ── available ──► parameters of the loop
///       └─ otherwise: awaited ── prepare(), on the preparation thread ──► parameters, or failure
///
/// The proxy is always available. A direct method reads fields that may have to be computed first, or
/// regenerated because they contain the stiffnesses of the tissues. While a method is awaited the current one
/// stays in effect. Members are guarded by the model's lock (LiveModel).
class MethodChoice final : public PreparedChoice {
 public:
  /// Generates fields for changed stiffnesses. May throw.
  using NewFields = std::function<Result<std::shared_ptr<const Model>>(
      const Model& current, const Model& prepared, const Progress& progress)>;
  /// Prepares a model for further methods. May throw.
  using MoreMethods = std::function<Result<std::shared_ptr<const Model>>(
      std::shared_ptr<const Model> model, std::span<const ForceMethod> methods, const Progress& progress)>;
  /// Starts or wakes the thread that calls prepare().
  using Wake = std::function<Result<void>(const LiveModel::Lock& lock)>;

  /// @param model, loop  outlive this object
  MethodChoice(LiveModel& model, SessionLoop& loop, NewFields rebuild_fields, MoreMethods prepare_methods,
               Wake wake);

  /// Whether viewers may choose the method; one that does not suit the volume or the tool is excluded.
  bool is_choosable(ForceMethod method) const { return choosable_[index_of(method)]; }
  /// Whether the method is available or its fields can be generated.
  bool can_be_prepared(const LiveModel::Lock& lock, ForceMethod method) const;

  /// @param method  choosable. Errors: kUnavailable without a thread for the preparation.
  Result<void> choose(const LiveModel::Lock& lock, ForceMethod method, RequestedBy by);
  /// Chooses the next method in a circle of those that can be prepared.
  void choose_next();
  /// Prepares the direct method that a script has selected, if its fields are missing. Does not block.
  void follow_script();

  /// Method that becomes active once its preparation is finished.
  std::optional<ForceMethod> awaited() const;
  /// Why the method requested last is not active.
  std::optional<Error> failure() const;
  /// Fills in the awaited method, and why the last choice failed.
  void describe(const LiveModel::Lock& lock, ViewedState& state) const;

  bool is_pending(const LiveModel::Lock& /*held*/) const override { return awaited_.has_value(); }
  void prepare(LiveModel::Lock& lock, const Progress& progress) override;
  void abandon_without_memory(const LiveModel::Lock& lock) noexcept override;

 private:
  bool is_available(const LiveModel::Lock& lock, ForceMethod method) const;
  Result<std::shared_ptr<const Model>> fields_for(ForceMethod method, const ModelVersions& versions,
                                                  const Progress& progress);
  Result<void> use_fields(const LiveModel::Lock& lock, std::shared_ptr<const Model> fields);
  void abandon(const LiveModel::Lock& lock, ForceMethod method, Error why);

  LiveModel& model_;
  SessionLoop& loop_;
  const NewFields rebuild_fields_;
  const MoreMethods prepare_methods_;
  const Wake wake_;
  const std::array<bool, kForceMethods.size()> choosable_;
  const std::shared_ptr<const Model> first_;  // model that the session began with

  std::optional<ForceMethod> awaited_;
  RequestedBy awaited_by_;
  std::uint32_t abandoned_ = 0;  // model version for which fields could not be generated
  std::optional<Error> failure_;
  std::shared_ptr<const Model> fields_;  // generated for an older version; used by prepare() only
};

/// Error of a method whose fields were generated for other stiffnesses and cannot be regenerated.
Error fields_for_other_stiffness();

}  // namespace palpate
