#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "palpate/device/pointer_driver.h"
#include "palpate/model/changed_model.h"
#include "palpate/recording/recording.h"
#include "palpate/scene/scene.h"
#include "palpate/server/viewer_server.h"
#include "palpate/servo/servo_loop.h"
#include "palpate/session/shared_plan.h"
#include "palpate/tissue/nearest.h"
#include "palpate/tissue/removed_volume.h"
#include "session/arming_code.h"
#include "session/consent.h"
#include "session/cut_list.h"
#include "session/deformed_labels.h"
#include "session/explore_watch.h"
#include "session/measured_cells.h"
#include "session/rate_meter.h"
#include "session/tissue_thread.h"
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
  bool asks_here = false;        ///< Whether an operator at this machine sees question() and answers it
  Training* training = nullptr;  ///< Tasks of the session; null if there are none. Outlives the session.
  /// Generates fields for changed stiffnesses; replaced in tests only. May throw.
  std::function<Result<std::shared_ptr<const Model>>(const Model& felt, const Model& made,
                                                     const Progress& progress)>
      new_fields = with_rebuilt_fields;
  /// Prepares a model for further methods; replaced in tests only. May throw.
  std::function<Result<std::shared_ptr<const Model>>(
      std::shared_ptr<const Model> model, std::span<const ForceMethod> methods, const Progress& progress)>
      more_methods = with_methods;
  /// Prepares a model for another tissue law; replaced in tests only. May throw.
  std::function<Result<MeasuredCells>(const Model& felt, TissueLaw law, std::size_t devices,
                                      const Progress& progress)>
      other_law = measured_under_law;
  /// Warning text: the model's soft tissue is solved in coarser cells than the scene requests because this
  /// machine is too slow. Empty if it is not.
  std::string coarser_tissue = {};
  std::shared_ptr<SharedPlan> plan = {};              ///< Plan being rehearsed; may be null
  std::shared_ptr<const Navigation> navigation = {};  ///< ExploreOptions::navigation
};

/// Session as controlled by its viewers and by keys. Requests are validated by the same rules as the scene
/// file and the command line, and reach the servo loop through its lock-free interfaces, so that no tick
/// waits. The object is constructed without a loop, so that a server that fails to start does so before any
/// force is rendered; requests are refused until begin().
///
/// Changing a tissue creates a new model version (palpate/model/changed_model.h). Every command passed to the
/// loop is logged in told() with its originator, for the recording. A low-priority thread prepares a direct
/// method when it is first chosen, and regenerates the fields of all direct methods when one is chosen after
/// a change of stiffness; until then the current method stays active. The same thread prepares a law of soft
/// tissue that needs other surfaces, or whose cell size on this machine has not been measured yet. If a
/// preparation fails the current method or law remains and state() gives the reason until another is chosen.
/// Preparing further methods does not create a model version. Thread-safe.
///
/// While a physical device can apply force, a viewer's changes need the consent of an operator at this
/// machine (session/consent.h). While the force is stopped, consent is needed only for changes that could
/// increase the force afterwards. A stop never needs consent.
class LiveSession final : public ViewerHost {
 public:
  explicit LiveSession(LiveSessionParts parts);
  ~LiveSession() override { end(); }
  /// Connects the session to the running loop, which must use the model and parameters of LiveSessionParts.
  /// @param loop, watch  outlive the session
  void begin(ServoLoop& loop, const ExploreWatch& watch);
  /// Ends the worker threads and disconnects the loop and the watch, which may then be destroyed.
  void end();

  // ---- interface for viewers
  const ViewedScene& scene() const override;
  TickRecord snapshot(std::array<double, kMaxDevices>& stiffness_N_per_mm) const override;
  ViewedHealth health() const override;
  ViewedState state() const override;
  std::vector<SweepRecord> sweeps(std::uint32_t version, std::uint64_t first,
                                  std::size_t most) const override;
  std::shared_ptr<const Bricks<LabelId>> labels() const override;
  std::shared_ptr<const ViewedYield> yielded(std::size_t device) const override;
  std::shared_ptr<const Bricks<LabelId>> seen_labels() const override { return seen_labels_.of(*this); }
  std::optional<ViewedNavigation> navigation() const override;
  Result<Grant> set(const SettingsRequest& request) override;
  Result<Grant> set(const TissueRequest& request) override;
  /// A stroke whose last sweeps have not been removed yet is undone or redone shortly afterwards.
  Result<Grant> set(const StrokeRequest& request) override;
  std::vector<LateAnswer> take_answers() override { return consent_.take_answers(); }
  void forget(const ViewerIdentity& viewer) override { consent_.forget(viewer); }
  void emergency_stop(const ViewerIdentity& by) override;
  Result<void> rearm(const RearmRequest& request) override;
  Result<void> take_pointer(bool take, const ViewerIdentity& by) override;
  void move_pointer(const std::array<double, 3>& tip_patient_mm) override;
  Result<void> play(const PlayRequest& request) override;
  ViewedTraining training() const override;
  std::shared_ptr<const ViewedDebriefing> debriefing() const override;
  Result<void> train(const TaskRequest& request) override;
  Result<void> teach(const LessonRequest& request) override;
  bool keeps_runs() const override { return parts_.training != nullptr && parts_.training->keeps_runs(); }
  Result<std::string> curves(const std::string& learner) const override;
  std::shared_ptr<const ViewedPlan> plan() const override;
  Result<void> change(const PlanRequest& request) override;

  // ---- keys at the device
  void stop_here();
  /// Stops the force because no supervisor process watches the session.
  void stop_unsupervised();
  /// Gives the force back after a stop.
  /// @param stop  number of the stop that was displayed to the operator
  /// Errors: those of a viewer's rearm; kUsage for a pointer, whose force is given back in the page.
  Result<void> rearm_here(std::uint32_t stop);
  void pause_here();
  /// Pending request of a viewer that needs consent here.
  std::optional<ConsentQuestion> question() { return consent_.question(); }
  void answer_here(std::uint64_t question, bool agreed) { consent_.answer(question, agreed); }
  /// Code by which the page can re-arm a physical device after the current stop. It is accepted from the
  /// first call on. Empty if nothing is stopped, no device is physical, or too many wrong codes were entered.
  std::string arming_code();
  /// Whether force is given back in the page: only a pointer moves the tip and no device is physical.
  bool rearmed_in_page() const { return parts_.pointer != nullptr && !physical(); }
  /// Number of the stop in effect; empty if there is none.
  std::optional<std::uint32_t> current_stop() const;
  void next_method();
  /// Toggles the burrs' motors. Errors: kBadInput if no device has a burr.
  Result<void> motor_here();
  /// Errors: those of a viewer's StrokeRequest.
  Result<void> stroke_here(StrokeAction action);
  /// Undoes or redoes the last stroke, with the motor off. Does nothing if there is no such stroke or the
  /// tool does not cut.
  void change_stroke_by_script(StrokeAction action);
  void change_law_by_script(TissueLaw law);
  /// Whether a teacher has ended the session.
  bool is_over() const { return is_over_; }
  /// Errors: those of Training::begin_or_end; kUsage if the session has no tasks.
  Result<void> task_here();
  /// Model version to which the script's last stroke change or law change led; see
  /// HandCommands::stroke_version and law_version.
  std::optional<std::uint32_t> script_stroke_version() const;
  std::optional<std::uint32_t> script_law_version() const;
  /// Prepares the direct method that a script has selected, if its fields are missing. Does not block.
  void follow_script();

  /// Method that becomes active once its preparation is finished.
  std::optional<ForceMethod> method_awaited() const;
  /// Reason why the method requested last is not active.
  std::optional<Error> method_failure() const;
  /// LiveSessionParts::coarser_tissue for the current law.
  std::string coarser_tissue() const;
  /// The same warnings for laws chosen since the session began, in chronological order.
  std::vector<std::string> later_coarser_tissue() const;
  /// Log of all commands passed to the loop since begin().
  EventLog& told() { return told_; }
  /// Highest value of the user's force limit so far.
  double highest_max_force_N() const;

 private:
  ViewedScene make_scene() const;
  bool physical() const;
  double most_force_N() const;
  bool is_choosable(ForceMethod method) const { return choosable_[index_of(method)]; }
  bool is_available(ForceMethod method) const;
  bool can_be_prepared(ForceMethod method) const;
  Result<void> check(const SettingsRequest& request, const Parameters& now) const;
  Result<ModelChange> check(const TissueRequest& request, const Parameters& now) const;
  bool wants_consent(bool feels_more) const;
  template <class Request>
  Result<Grant> ask(const Request& request, std::string what);
  /// Stroke request with the number of strokes begun when it was made; it is obsolete once another stroke
  /// begins.
  struct LastStrokeRequest : StrokeRequest {
    std::uint32_t strokes = 0;
  };
  Result<void> check(const LastStrokeRequest& request, const Parameters& now) const;
  Result<void> apply(const SettingsRequest& request, AskedBy by);
  Result<void> apply(const LastStrokeRequest& request, AskedBy by);
  Result<void> apply(const TissueRequest& request, AskedBy by);
  Result<void> choose(ForceMethod method, AskedBy by, ServoLoop& loop);
  void run_maker();
  Result<std::shared_ptr<const Model>> fields_for(ForceMethod method, const ModelVersions& of,
                                                  std::shared_ptr<const Model>& fields,
                                                  const Progress& progress) const;
  Result<void> use_fields(std::shared_ptr<const Model> fields);
  void give_up(ForceMethod method, Error why);
  void start_tissue_thread(ServoLoop& loop);
  Result<void> change_law(TissueLaw law, AskedBy by, ServoLoop& loop);
  void go_by(const Model& under, double coarsened, AskedBy by, ServoLoop& loop);
  void prepare_law(std::unique_lock<std::mutex>& lock, const Progress& progress);
  void abandon_law(Error why);
  Result<void> start_maker();
  void apply_version(ModelVersions next, const ModelChange& change, AskedBy by, ServoLoop& loop);
  void run_cutter();
  void cut(std::span<const Cut> cuts, ServoLoop& loop);
  void change_strokes(ServoLoop& loop);
  std::ptrdiff_t strokes_left(StrokeAction action) const;
  void stop(AskedBy by);
  Result<void> rearm(std::uint32_t stop, AskedBy by);
  Result<void> check_stiffness_change(double from_N_per_mm, double to_N_per_mm, ForceMethod method) const;
  bool cuts() const;
  double felt_stiffness_N_per_mm(const TickRecord& tick, std::size_t number) const;

  const LiveSessionParts parts_;
  const std::array<bool, kForceMethods.size()> choosable_;
  mutable std::once_flag scene_made_;
  mutable ViewedScene scene_;
  mutable DeformedLabels seen_labels_;

  EventLog told_;
  ArmingCode arming_code_;
  std::atomic<ServoLoop*> loop_{nullptr};
  const ExploreWatch* watch_ = nullptr;  // set before loop_
  mutable std::mutex stop_mutex_;        // guards stopped_by_, and stops requested before there is a loop
  AskedBy stopped_by_;                   // guarded by stop_mutex_
  std::atomic<bool> stopped_early_{false}, pointer_taken_{false}, is_over_{false};
  Consent consent_;

  mutable std::mutex mutex_;  // guards the members up to later_coarser_
  ModelVersions model_;
  CutList cuts_;           // sweeps and stroke changes of model_
  RemovedVolume removed_;  // volume removed by cuts_
  NearestMeter nearest_;   // distance of the cuts to structures
  struct WantedStroke {
    StrokeAction action;
    AskedBy by;
    std::uint32_t strokes = 0;  // strokes begun when it was requested
  };
  std::deque<WantedStroke> strokes_wanted_;  // queue of undo and redo requests
  std::optional<std::uint32_t> script_stroke_led_to_, script_law_led_to_;
  double highest_max_force_N_;
  std::optional<ForceMethod> awaited_;  // direct method that becomes active once its fields are generated
  AskedBy awaited_by_;                  // originator of that request
  std::uint32_t given_up_ = 0;          // model version for which fields could not be generated
  std::optional<Error> method_failure_;
  std::optional<TissueLaw> law_awaited_;  // tissue law that becomes active once its surfaces are built
  AskedBy law_awaited_by_;                // originator of that request
  std::optional<Error> law_failure_;
  // cell size per tissue law as measured on this machine; factor 0: not measured
  struct Carried {
    double coarsened = 0;
    std::string told;
  };
  std::array<Carried, ModelChange::kLaws> carried_;
  Carried& measured_cells_of(TissueLaw law) { return carried_[static_cast<std::size_t>(law)]; }
  const Carried& measured_cells_of(TissueLaw law) const { return carried_[static_cast<std::size_t>(law)]; }
  std::vector<std::string> later_coarser_;

  std::condition_variable wanted_;
  std::atomic<bool> ending_{false};
  std::thread maker_;                     // generates fields and prepares laws; started on first demand
  std::thread cutter_;                    // removes what a burr sweeps; runs only if a tool cuts
  std::unique_ptr<TissueThread> tissue_;  // runs only if tissue deforms
  std::atomic<const TissueThread*> yields_{nullptr};

  mutable std::mutex health_mutex_;
  mutable RateMeter rate_;
  mutable std::chrono::steady_clock::time_point health_until_{};
  mutable ViewedHealth health_;
};

}  // namespace palpate
