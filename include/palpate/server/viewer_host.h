#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "palpate/device/sweep_record.h"
#include "palpate/server/viewed_plan.h"
#include "palpate/server/viewed_scene.h"
#include "palpate/server/viewed_state.h"
#include "palpate/server/viewed_training.h"
#include "palpate/server/viewer_requests.h"

/// Interface by which a viewer server observes and changes a session or a recording.
namespace palpate {

class LiveHost;
class PlaybackHost;
class TickHistory;

/// Source of the data that viewers observe: a live session or a recording. A host that is neither a LiveHost
/// nor a PlaybackHost is read-only, except for the emergency stop. scene(), snapshot(), health(), state(),
/// labels() and emergency_stop() are called on any thread, every other member on the server's unless stated
/// otherwise; none may wait for the servo, and none may take longer than copying one tick's data
/// (milliseconds).
class ViewerHost {
 public:
  virtual ~ViewerHost() = default;
  /// This host as a running session or as a recording; null if it is not one.
  virtual LiveHost* live() { return nullptr; }
  virtual PlaybackHost* playback() { return nullptr; }

  /// The same object for the lifetime of the server. Scan and labels share one grid.
  virtual const ViewedScene& scene() const = 0;
  /// Latest tick.
  /// @param stiffness_N_per_mm  rendered stiffness of the tissue in contact, per device
  virtual TickRecord snapshot(std::array<double, kMaxDevices>& stiffness_N_per_mm) const = 0;
  /// All recent ticks, for viewers that receive every one; null: there are none, as in a recording. Constant;
  /// outlives the server.
  virtual const TickHistory* tick_history() const { return nullptr; }
  virtual ViewedHealth health() const = 0;
  virtual ViewedState state() const = 0;
  /// Sweeps of ViewedState::sweeps from index `first` on, at most `most`, in order.
  /// @param version  ViewedState::model_version; the current version may be newer
  virtual std::vector<SweepRecord> sweeps(std::uint32_t /*version*/, std::uint64_t /*first*/,
                                          std::size_t /*most*/) const {
    return {};
  }
  /// The scene's labels minus the volume removed so far, consistent with sweeps(). Called on any thread; not
  /// for time-critical callers, since a recording's labels are computed on demand.
  virtual std::shared_ptr<const Bricks<LabelId>> labels() const { return scene().labels; }
  /// Deformation around a device's tool; null: none.
  virtual std::shared_ptr<const ViewedDeformation> deformation(std::size_t /*device*/) const {
    return nullptr;
  }
  /// labels() deformed by soft tissue, for volume pictures. As slow as labels(); returns the same object
  /// while nothing changes.
  virtual std::shared_ptr<const Bricks<LabelId>> visible_labels() const { return labels(); }
  /// Progress of a run of one of the scene's tasks.
  virtual ViewedTraining training() const { return {}; }
  /// Debriefing of the last run, once it is over and stored; null: none.
  virtual std::shared_ptr<const ViewedDebriefing> debriefing() const { return nullptr; }

  /// Stops the force, or a recording that plays; never releases a stop.
  virtual void emergency_stop(const ViewerIdentity& by) = 0;

  /// Plan being rehearsed, a new object after each change; null: none.
  virtual std::shared_ptr<const ViewedPlan> plan() const { return nullptr; }
  /// Carries out the whole request, or returns an error. Saving waits for the disk.
  virtual Result<void> change(const PlanRequest& /*request*/) {
    return Error{ErrorKind::kUsage, "this session has no plan", "", "start palpate explore with --plan"};
  }
};

/// Running session, which viewers may change.
class LiveHost : public ViewerHost {
 public:
  LiveHost* live() final { return this; }

  /// State of a tracked tool; empty: none.
  virtual std::optional<ViewedNavigation> navigation() const { return {}; }
  /// Carries out the whole request, or returns an error that names the offending value and changes nothing.
  virtual Result<RequestOutcome> set(const SettingsRequest& request) = 0;
  virtual Result<RequestOutcome> set(const TissueRequest& request) = 0;
  virtual Result<RequestOutcome> set(const StrokeRequest& request) = 0;
  /// Outcomes of earlier requests; each is returned once.
  virtual std::vector<LateAnswer> read_answers() = 0;
  /// Discards the pending requests of a viewer that disconnected.
  virtual void forget(const ViewerIdentity& viewer) = 0;
  /// Error kUsage if a device is physical and the code is missing or wrong, if another stop followed the one
  /// referred to, if the tip is in contact, and if nothing is stopped.
  virtual Result<void> rearm(const RearmRequest& request) = 0;
  /// Takes or releases control of the pointer. Error kUsage if the tip has another source.
  /// @param by  viewer that takes or releases it
  virtual Result<void> claim_pointer(bool take, const ViewerIdentity& by) = 0;
  /// Moves the pointer's tip; empty: its pose is stale until the next target.
  virtual void move_pointer(const std::optional<PointerTarget>& target) = 0;
  /// Begins or ends a run.
  virtual Result<void> train(const TaskRequest& /*request*/) {
    return Error{ErrorKind::kUsage, "this session has no tasks", "", ""};
  }
  /// Applies lesson settings, except for the names and the pointer, which the server handles.
  virtual Result<void> teach(const LessonRequest& /*request*/) {
    return Error{ErrorKind::kUsage, "there is no session for a lesson", "", ""};
  }
  /// Whether learners' runs are stored, so that curves can be computed from them.
  virtual bool stores_runs() const { return false; }
  /// HTML page with the learning curves of a learner, or of all learners (empty). Called on any thread; may
  /// take long.
  virtual Result<std::string> curves(const std::string& /*learner*/) const {
    return Error{ErrorKind::kUsage, "this session records no runs", "",
                 "start palpate explore with --learner"};
  }
};

/// Recording played back.
class PlaybackHost : public ViewerHost {
 public:
  PlaybackHost* playback() final { return this; }

  virtual Result<void> play(const PlayRequest& request) = 0;
};

}  // namespace palpate
