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
#include "palpate/link/viewer_server.h"
#include "palpate/model/changed_model.h"
#include "palpate/recording/recording.h"
#include "palpate/scene/scene.h"
#include "palpate/servo/servo_loop.h"
#include "palpate/session/shared_plan.h"
#include "palpate/tissue/nearest.h"
#include "palpate/tissue/removed_volume.h"
#include "session/arming_code.h"
#include "session/carried_cells.h"
#include "session/consent.h"
#include "session/cut_list.h"
#include "session/explore_watch.h"
#include "session/rate_meter.h"
#include "session/seen_labels.h"
#include "session/tissue_thread.h"
#include "session/training.h"

namespace palpate {

/// What a session is made of before it runs.
struct ViewedParts {
  /// Ready for the proxy, where that may be chosen, and for what a script changes to; the other direct
  /// methods are made ready when they are wanted.
  std::shared_ptr<const Model> model;
  std::vector<DeviceInfo> devices;
  WorkspaceSettings workspace;
  Parameters parameters;  ///< of the first tick
  std::string input;      ///< who moves the tip: "script", "pointer", "device"
  double rate_hz = 1000;
  PointerDriver* pointer = nullptr;  ///< where a viewer moves the tip; outlives the session
  bool recording = false;
  Modality modality = Modality::kUnknown;  ///< as the scene says it
  bool asks_here = false;                  ///< somebody at this machine sees question() and answers
  Training* training = nullptr;            ///< where there are tasks; outlives the session
  /// As with_new_fields, which it is but in tests; may throw.
  std::function<Result<std::shared_ptr<const Model>>(const Model& felt, const Model& made,
                                                     const Progress& progress)>
      new_fields = with_new_fields;
  /// As with_methods, likewise.
  std::function<Result<std::shared_ptr<const Model>>(
      std::shared_ptr<const Model> model, std::span<const ForceMethod> methods, const Progress& progress)>
      more_methods = with_methods;
  /// As carried_under_law, which it is but in tests; may throw.
  std::function<Result<CarriedCells>(const Model& felt, TissueLaw law, std::size_t devices,
                                     const Progress& progress)>
      other_law = carried_under_law;
  /// That the model's soft tissue is solved in coarser cells than the scene has because this machine is
  /// slower, in words; empty: it is not.
  std::string coarser_tissue = {};
  std::shared_ptr<SharedPlan> plan = {};              ///< that is rehearsed; may be null
  std::shared_ptr<const Navigation> navigation = {};  ///< ExploreOptions::navigation
};

/// A session as its viewers and its keys change it. What they ask for is validated as a scene and the command
/// line are, and goes to the loop by its usual ways, so that no tick waits for anybody. It begins without a
/// loop, so that who serves it can fail before anything pushes; requests are refused until begin().
///
/// A tissue that changes becomes a new version of the model (session/changed_model.h). Whatever the loop is
/// told stands in told(), with who asked, for the recording. A direct method is made ready when it is chosen
/// first, and the fields of all of them anew when one is chosen after a change of stiffness, on a thread of
/// its own, at the lowest priority; until then the method stays as it was. Likewise a law of soft tissue that
/// has other surfaces, or of which it is not known yet in which cells this machine solves it. Where that
/// cannot be it stays so, and state() says why until another is chosen. Being ready for more methods is no
/// new version. Any thread.
///
/// While a physical device may push, what viewers want to change waits until somebody at this machine agrees
/// to it (session/consent.h); while it is stopped, so does what would make a hand feel more afterwards. A
/// stop needs nobody's consent.
class ViewedSession final : public ViewerHost {
 public:
  explicit ViewedSession(ViewedParts parts);
  ~ViewedSession() override { end(); }
  /// The loop runs with the parts' model and parameters. @param loop, watch  outlive the session
  void begin(ServoLoop& loop, const ExploreWatch& watch);
  /// Nobody asks for anything any more: the loop and the watch may go.
  void end();

  // ---- viewers
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
  /// Of a stroke, whose last sweeps are still to be cut, a moment later.
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

  // ---- keys, at the device itself
  void stop_here();
  /// Nobody watches the session from outside any more.
  void stop_unwatched();
  /// @param stop  the one that was shown. Errors: those of a viewer's rearm; a pointer's force is given back
  /// in the page.
  Result<void> rearm_here(std::uint32_t stop);
  void pause_here();
  /// What a viewer wants and somebody here is to agree to.
  std::optional<ConsentQuestion> question() { return consent_.question(); }
  void answer_here(std::uint64_t question, bool agreed) { consent_.answer(question, agreed); }
  /// By which a page arms a physical device after the stop that holds; from the first call on it is taken.
  /// Empty: nothing is stopped, there is no such device, or there were too many wrong ones.
  std::string arming_code();
  /// A pointer's force is given back in the page, where nothing else can push.
  bool rearmed_in_page() const { return parts_.pointer != nullptr && !physical(); }
  /// The number of the stop that holds.
  std::optional<std::uint32_t> stop_that_holds() const;
  void next_method();
  /// On or off. Errors: kBadInput where no device's tool has one.
  Result<void> motor_here();
  /// Errors: those of a viewer's StrokeRequest.
  Result<void> stroke_here(StrokeAction action);
  /// The motor is off. Where there is no such stroke, or the tool cuts nothing, nothing is done.
  void change_stroke_by_script(StrokeAction action);
  void change_law_by_script(TissueLaw law);
  /// A teacher has ended the session.
  bool is_over() const { return is_over_; }
  /// Errors: those of Training::begin_or_end; kUsage where there are no tasks.
  Result<void> task_here();
  /// HandCommands::stroke_led_to and law_led_to, of the last of them.
  std::optional<std::uint32_t> script_stroke_led_to() const;
  std::optional<std::uint32_t> script_law_led_to() const;
  /// A script may choose a direct method whose fields are not there: they are made. Looks and does not wait.
  void follow_script();

  /// That is felt as soon as it is made ready.
  std::optional<ForceMethod> method_awaited() const;
  /// Why the method that was asked for last is not felt.
  std::optional<Error> method_failure() const;
  /// As ViewedParts has it, of the law that is felt.
  std::string coarser_tissue() const;
  /// What was told of laws that were chosen since the session began, in their order.
  std::vector<std::string> later_coarser_tissue() const;
  /// What the loop is told, from begin() on.
  EventLog& told() { return told_; }
  /// The user's limit of the force, where it stood highest.
  double highest_max_force_N() const;

 private:
  ViewedScene make_scene() const;
  bool physical() const;
  double most_force_N() const;
  bool can_be_chosen(ForceMethod method) const { return choosable_[index_of(method)]; }
  bool can_feel(ForceMethod method) const;
  bool can_be_made(ForceMethod method) const;
  Result<void> check(const SettingsRequest& request, const Parameters& now) const;
  Result<ModelChange> check(const TissueRequest& request, const Parameters& now) const;
  bool wants_consent(bool feels_more) const;
  template <class Request>
  Result<Grant> ask(const Request& request, std::string what);
  /// With how many strokes had begun when it was asked for: it is of those alone.
  struct LastStrokeRequest : StrokeRequest {
    std::uint32_t strokes = 0;
  };
  Result<void> check(const LastStrokeRequest& request, const Parameters& now) const;
  Result<void> apply(const SettingsRequest& request, AskedBy by);
  Result<void> apply(const LastStrokeRequest& request, AskedBy by);
  Result<void> apply(const TissueRequest& request, AskedBy by);
  Result<void> choose(ForceMethod method, AskedBy by, ServoLoop& loop);
  void make_fields();
  Result<std::shared_ptr<const Model>> fields_for(ForceMethod method, const ModelVersions& of,
                                                  std::shared_ptr<const Model>& fields,
                                                  const Progress& progress) const;
  Result<void> feel_by(std::shared_ptr<const Model> fields);
  void give_up(ForceMethod method, Error why);
  void move_tissue(ServoLoop& loop);
  Result<void> change_law(TissueLaw law, AskedBy by, ServoLoop& loop);
  void go_by(const Model& under, double coarsened, AskedBy by, ServoLoop& loop);
  void make_law(std::unique_lock<std::mutex>& lock, const Progress& progress);
  void give_up_law(Error why);
  Result<void> start_maker();
  void go_on_with(ModelVersions next, const ModelChange& change, AskedBy by, ServoLoop& loop);
  void cut_along();
  void cut(std::span<const Cut> cuts, ServoLoop& loop);
  void change_strokes(ServoLoop& loop);
  std::ptrdiff_t strokes_left(StrokeAction action) const;
  void stop(AskedBy by);
  Result<void> rearm(std::uint32_t stop, AskedBy by);
  Result<void> check_stiffness_change(double from_N_per_mm, double to_N_per_mm, ForceMethod method) const;
  bool cuts() const;
  double felt_stiffness_N_per_mm(const TickRecord& tick, std::size_t number) const;

  const ViewedParts parts_;
  const std::array<bool, kForceMethods.size()> choosable_;
  mutable std::once_flag scene_made_;
  mutable ViewedScene scene_;
  mutable SeenLabels seen_labels_;

  EventLog told_;
  ArmingCode arming_code_;
  std::atomic<ServoLoop*> loop_{nullptr};
  const ExploreWatch* watch_ = nullptr;  // set before loop_
  mutable std::mutex stop_mutex_;        // of who stops, and of what is stopped before there is a loop
  AskedBy stopped_by_;                   // of the mutex above
  std::atomic<bool> stopped_early_{false}, pointer_taken_{false}, is_over_{false};
  Consent consent_;

  mutable std::mutex mutex_;  // of what follows
  ModelVersions model_;
  CutList cuts_;           // of it
  RemovedVolume removed_;  // by them
  NearestMeter nearest_;   // of them
  struct WantedStroke {
    StrokeAction action;
    AskedBy by;
    std::uint32_t strokes = 0;  // that had begun when it was asked for
  };
  std::deque<WantedStroke> strokes_wanted_;  // to be undone or done again
  std::optional<std::uint32_t> script_stroke_led_to_, script_law_led_to_;
  double highest_max_force_N_;
  std::optional<ForceMethod> awaited_;  // the direct method that is felt when its fields are made
  AskedBy awaited_by_;                  // who wants it
  std::uint32_t given_up_ = 0;          // the version whose fields could not be made
  std::optional<Error> method_failure_;
  std::optional<TissueLaw> law_awaited_;  // that is felt when its surfaces are made
  AskedBy law_awaited_by_;                // who wants it
  std::optional<Error> law_failure_;
  // of the laws by which tissue yields, where this machine was tried; factor 0: it was not
  struct Carried {
    double coarsened = 0;
    std::string told;
  };
  std::array<Carried, ModelChange::kLaws> carried_;
  Carried& carried_of(TissueLaw law) { return carried_[static_cast<std::size_t>(law)]; }
  const Carried& carried_of(TissueLaw law) const { return carried_[static_cast<std::size_t>(law)]; }
  std::vector<std::string> later_coarser_;

  std::condition_variable wanted_;
  std::atomic<bool> ending_{false};
  std::thread maker_;                     // of fields and laws; begun when the first are wanted
  std::thread cutter_;                    // of what a burr takes away; where the tool is one
  std::unique_ptr<TissueThread> tissue_;  // where tissue yields
  std::atomic<const TissueThread*> yields_{nullptr};

  mutable std::mutex health_mutex_;
  mutable RateMeter rate_;
  mutable std::chrono::steady_clock::time_point health_until_{};
  mutable ViewedHealth health_;
};

}  // namespace palpate
