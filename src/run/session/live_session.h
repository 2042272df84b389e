#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "palpate/device/model_change.h"
#include "palpate/device/pointer_driver.h"
#include "palpate/device/sweep_record.h"
#include "palpate/loading/loading.h"
#include "palpate/model/changed_model.h"
#include "palpate/recording/event_log.h"
#include "palpate/recording/recording.h"
#include "palpate/scene/scene.h"
#include "palpate/server/tick_history.h"
#include "palpate/server/viewer_host.h"
#include "palpate/servo/servo_loop.h"
#include "palpate/session/shared_plan.h"
#include "session/consent.h"
#include "session/cutter.h"
#include "session/deformed_labels.h"
#include "session/law_choice.h"
#include "session/live_model.h"
#include "session/measured_cells.h"
#include "session/method_choice.h"
#include "session/originator.h"
#include "session/preparation_thread.h"
#include "session/rate_meter.h"
#include "session/session_loop.h"
#include "session/session_statistics.h"
#include "session/stop_switch.h"
#include "session/training.h"

namespace palpate {

/// Everything from which a session is built before it runs.
struct LiveSessionParts {
  /// Model prepared for the proxy, if that can be chosen, and for the methods that the script selects. Other
  /// direct methods are prepared on demand.
  std::shared_ptr<const Model> model;
  std::vector<DeviceInfo> devices;
  WorkspaceSettings workspace;
  Parameters parameters;  ///< Parameters of the first tick
  std::string input;      ///< Source of the tip's motion: "script", "pointer" or "device"
  double rate_hz = 1000;
  /// Driver by which a viewer moves the tip; null if there is none. Outlives the session.
  PointerDriver* pointer = nullptr;
  bool recording = false;
  Modality modality = Modality::kUnknown;  ///< Modality that the scene declares
  bool has_operator = false;     ///< Whether an operator at this machine sees question() and answers it
  Training* training = nullptr;  ///< Tasks of the session; null if there are none. Outlives the session.
  // steps that tests replace
  MethodChoice::NewFields rebuild_fields = with_rebuilt_fields;
  MethodChoice::MoreMethods prepare_methods = prepared_with_cache;
  LawChoice::Prepare prepare_law = measured_under_law;
  TissueFrames::Solve solve_tissue = begin_tissue_frame;
  /// Warning text: the model's soft tissue is solved in coarser cells than the scene requests because this
  /// machine is too slow. Empty if it is not.
  std::string coarser_tissue = {};
  std::shared_ptr<SharedPlan> plan = {};              ///< Plan being rehearsed; may be null
  std::shared_ptr<const Navigation> navigation = {};  ///< ExploreOptions::navigation
  /// Whether soft tissue is solved and removed by threads of the session; otherwise by run_step().
  bool threads = true;
};

/// Session as controlled by its viewers and by keys: a facade over its parts.
///
///    viewers' thread ─┐                ┌─ StopSwitch      stops and rearms; never waits for the others
///    keys' thread ────┼─ LiveSession ──┼─ LiveModel       current model version, and the lock of all below
///    script's thread ─┘                ├─ MethodChoice ┬─ PreparationThread, lowest priority
///                                      ├─ LawChoice ───┴─ TissueThread, solves soft tissue
///                                      └─ Cutter          its own thread
///
/// A session without threads (LiveSessionParts::threads) solves and cuts by run_step() instead.
///
/// Requests are validated by the same rules as the scene file and the command line, and reach the servo loop
/// through its lock-free interfaces, so that no tick waits. The object is constructed without a loop, so that
/// a server that fails to start does so before any force is rendered; requests are refused until begin().
/// Every command passed to the loop is logged in log() with its originator, for the recording. Thread-safe.
///
/// While a physical device can apply force, a viewer's changes need the consent of an operator at this
/// machine (session/consent.h). While the force is stopped, consent is needed only for changes that could
/// increase the force afterwards. A stop never needs consent.
class LiveSession final : public LiveHost {
 public:
  explicit LiveSession(LiveSessionParts parts);
  ~LiveSession() override { end(); }
  /// Connects the session to the running loop, which must use the model and parameters of LiveSessionParts.
  /// @param loop, statistics  outlive the session
  void begin(ServoLoop& loop, const SessionStatistics& statistics);
  /// Makes the next steps of solving and removing soft tissue that are due, for a session without threads.
  /// Called between ticks: it takes at most as long as one step of TissueFrames and one of Cutter.
  /// @returns whether another step is due
  bool run_step(std::chrono::steady_clock::time_point now);
  /// Refuses requests from now on and ends the worker threads. Viewers still observe the loop and the
  /// statistics.
  void close();
  /// close(), and disconnects the loop and the statistics, which may then be destroyed. No viewer may be
  /// connected.
  void end();

  // ---- interface for viewers
  const ViewedScene& scene() const override;
  TickRecord snapshot(std::array<double, kMaxDevices>& stiffness_N_per_mm) const override;
  const TickHistory* tick_history() const override { return &history_; }
  ViewedHealth health() const override;
  ViewedState state() const override;
  std::vector<SweepRecord> sweeps(std::uint32_t version, std::uint64_t first,
                                  std::size_t max_count) const override {
    return cutter_.sweeps(version, first, max_count);
  }
  std::shared_ptr<const Bricks<LabelId>> labels() const override;
  std::shared_ptr<const ViewedDeformation> deformation(std::size_t device) const override {
    return law_.deformation(device);
  }
  std::shared_ptr<const Bricks<LabelId>> visible_labels() const override { return visible_labels_.of(*this); }
  std::optional<ViewedNavigation> navigation() const override;
  Result<RequestOutcome> set(const SettingsRequest& request) override;
  Result<RequestOutcome> set(const TissueRequest& request) override;
  /// A stroke whose last sweeps have not been removed yet is undone or redone shortly afterwards.
  Result<RequestOutcome> set(const StrokeRequest& request) override;
  std::vector<LateAnswer> read_answers() override { return consent_.read_answers(); }
  void forget(const ViewerIdentity& viewer) override { consent_.forget(viewer); }
  void emergency_stop(const ViewerIdentity& by) override { stop_.stop(requested_by(by)); }
  Result<void> rearm(const RearmRequest& request) override { return stop_.rearm(request); }
  Result<void> claim_pointer(bool take, const ViewerIdentity& by) override;
  void move_pointer(const std::optional<PointerTarget>& target) override;
  ViewedTraining training() const override;
  std::shared_ptr<const ViewedDebriefing> debriefing() const override;
  Result<void> train(const TaskRequest& request) override;
  Result<void> teach(const LessonRequest& request) override;
  bool stores_runs() const override { return parts_.training != nullptr && parts_.training->stores_runs(); }
  Result<std::string> curves(const std::string& learner) const override;
  std::shared_ptr<const ViewedPlan> plan() const override;
  Result<void> change(const PlanRequest& request) override;

  /// Passes a tick on to viewers that receive every one. Called with each tick in order, on one thread, which
  /// is not the servo's.
  void observe(const TickRecord& record) { history_.add(record); }

  // ---- keys at the device
  void stop_by_key() { stop_.stop({Originator::kKey}); }
  /// Stops the force because no supervisor process watches the session.
  void stop_unsupervised() { stop_.stop({Originator::kSession}); }
  /// Re-arms the force after a stop.
  /// @param stop  number of the stop that was displayed to the operator
  /// Errors: those of a viewer's rearm; kUsage for a pointer, which is re-armed in the page.
  Result<void> rearm_by_key(std::uint32_t stop);
  void pause_by_key();
  /// Pending request of a viewer that needs consent here.
  std::optional<ConsentQuestion> question() { return consent_.question(); }
  void answer_by_key(std::uint64_t question, bool agreed) { consent_.answer(question, agreed); }
  /// StopSwitch::arming_code
  std::string arming_code() { return stop_.arming_code(); }
  /// Whether the force is re-armed in the page: only a pointer moves the tip and no device is physical.
  bool rearmed_in_page() const { return parts_.pointer != nullptr && !physical(); }
  /// Number of the stop in effect; empty if there is none.
  std::optional<std::uint32_t> current_stop() const { return stop_.current(); }
  void next_method() { method_.choose_next(); }
  /// Toggles the burrs' motors. Errors: kBadInput if no device has a burr.
  Result<void> toggle_motor_by_key();
  /// Errors: those of a viewer's StrokeRequest.
  Result<void> change_stroke_by_key(StrokeAction action);
  /// Cutter::request_by_script
  void change_stroke_by_script(StrokeAction action) { cutter_.request_by_script(action); }
  void change_law_by_script(TissueLaw law) { law_.choose_by_script(law); }
  /// Whether a teacher has ended the session.
  bool is_over() const { return is_over_; }
  /// Errors: those of Training::begin_or_end; kUsage if the session has no tasks.
  Result<void> begin_or_end_task_by_key();
  /// Model version produced by the script's last stroke change or law change; see
  /// HandCommands::stroke_version and law_version.
  std::optional<std::uint32_t> script_stroke_version() const { return cutter_.script_version(); }
  std::optional<std::uint32_t> script_law_version() const { return law_.script_version(); }
  /// MethodChoice::follow_script
  void follow_script() { method_.follow_script(); }

  /// Method that becomes active once its preparation is finished.
  std::optional<ForceMethod> method_awaited() const { return method_.awaited(); }
  /// Reason why the method requested last is not active.
  std::optional<Error> method_failure() const { return method_.failure(); }
  /// LiveSessionParts::coarser_tissue for the current law.
  std::string coarser_tissue() const { return law_.coarser_tissue(); }
  /// LawChoice::later_warnings
  std::vector<std::string> later_tissue_warnings() const { return law_.later_warnings(); }
  /// Log of all commands passed to the loop since begin().
  EventLog& log() { return loop_.log(); }
  /// Highest value of the user's force limit so far.
  double highest_force_limit_N() const;

 private:
  ViewedScene make_scene() const;
  /// Loop that requests may command; null before begin() and after close().
  ServoLoop* commanded_loop() const;
  bool physical() const;
  bool cuts() const;
  double max_selectable_force_N() const;
  bool needs_consent(bool could_increase_force) const;
  template <class Request>
  Result<RequestOutcome> request_consent(const Request& request, std::string what);
  /// Stroke request with the number of strokes begun when it was made.
  struct LastStrokeRequest : StrokeRequest {
    std::uint32_t strokes = 0;
    Cutter::StrokeChange change() const { return {action, strokes}; }
  };
  void set_tip_holder(const std::optional<ViewerIdentity>& holder);
  using Lock = LiveModel::Lock;
  Result<void> check(const Lock& lock, const SettingsRequest& request, const Parameters& now) const;
  Result<ModelChange> check(const Lock& lock, const TissueRequest& request, const Parameters& now) const;
  Result<void> check(const Lock& lock, const LastStrokeRequest& request, const Parameters& now) const;
  Result<void> apply(const Lock& lock, const SettingsRequest& request, RequestedBy by);
  Result<void> apply(const Lock& lock, const TissueRequest& request, RequestedBy by);
  Result<void> apply(const Lock& lock, const LastStrokeRequest& request, RequestedBy by);

  const LiveSessionParts parts_;
  mutable std::once_flag scene_made_;
  mutable ViewedScene scene_;
  mutable DeformedLabels visible_labels_;

  TickHistory history_;
  SessionLoop loop_;
  const SessionStatistics* statistics_ = nullptr;  // set before the loop is connected
  StopSwitch stop_;
  LiveModel model_;
  MethodChoice method_;
  LawChoice law_;
  Cutter cutter_;
  PreparationThread preparation_;
  double highest_max_force_N_;  // guarded by the model's lock
  Consent consent_;
  std::atomic<bool> pointer_claimed_{false}, is_over_{false}, is_closed_{false};

  mutable std::mutex health_mutex_;  // guards the members below
  mutable RateMeter rate_;
  mutable std::chrono::steady_clock::time_point health_until_{};
  mutable ViewedHealth health_;
};

}  // namespace palpate
