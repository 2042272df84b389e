#include <algorithm>
#include <utility>
#include <vector>

#include "server/hub.h"
#include "server/viewer.h"

namespace palpate::server {
namespace {

// permission that a request needs
Permission permission_for(const Request& request) {
  if (const auto* settings = std::get_if<SettingsRequest>(&request.body)) {
    bool is_haptic = settings->law.has_value();
    visit_settings([&](const auto& setting) {
      is_haptic = is_haptic || (setting.is_haptic && settings->*setting.change);
    });
    return is_haptic ? Permission::kChangeContact : Permission::kOperateTool;
  }
  if (std::holds_alternative<TissueRequest>(request.body)) return Permission::kChangeContact;
  if (std::holds_alternative<PlanRequest>(request.body)) return Permission::kPlan;
  if (std::holds_alternative<PlayRequest>(request.body)) return Permission::kPlay;
  if (std::holds_alternative<LessonRequest>(request.body)) return Permission::kLesson;
  return Permission::kOperateTool;
}

Result<RequestOutcome> outcome_of(const Result<void>& done) {
  return done ? Result<RequestOutcome>(RequestOutcome::kDone) : done.error();
}

// refusal of a request that only a running session can carry out
Error read_only_error(ViewerHost& host) {
  if (host.playback() != nullptr)
    return {ErrorKind::kUsage, "this is a recording: its contact settings cannot be changed", "",
            "start a live session of the scene with palpate explore"};
  return {ErrorKind::kUsage, "this session is view-only", "", ""};
}

}  // namespace

void Hub::welcome(Viewer& viewer) {
  viewer.set_number(++last_viewer_number_);
  update_viewer_count();
  publish_state();
  // the learner whose turn it is gets a free pointer
  const std::string& learner = viewer.who().learner;
  if (!pointer_owner_ && viewer.who().role == Role::kLearner && learner == state_.lesson.learner) {
    hand_over_pointer(&viewer);
    publish_state();
  }
  viewer.notify_state();
  // a late viewer gets the current data, not what was last sent to others
  if (viewer.receives_deformation()) publish_deformation(Clock::now());
  if (viewer.receives_training()) publish_training(Clock::now());
  viewer.notify_training();
  if (std::exchange(pose_timer_runs_, true)) return;
  next_pose_ = Clock::now();
  wait_for_poses();
}

void Hub::update_viewer_count() {
  welcomed_ = static_cast<int>(
      std::count_if(viewers_.begin(), viewers_.end(), [](const auto& viewer) { return viewer->welcomed(); }));
  on_viewer_count_(welcomed_);
}

std::string Hub::answer(Viewer& viewer, const Request& request) {
  const auto outcome = execute(viewer, request);
  if (!outcome) return refused_json(request.id, outcome.error());
  return *outcome == RequestOutcome::kAwaitingConsent ? consent_request_json(request.id)
                                                      : done_json(request.id);
}

Result<RequestOutcome> Hub::execute(Viewer& viewer, const Request& request) {
  // every viewer may stop
  if (std::holds_alternative<StopRequest>(request.body)) {
    host_.emergency_stop(viewer.identity());
    return RequestOutcome::kDone;
  }
  if (const auto* refusal = std::get_if<Error>(&request.body)) return *refusal;
  const Permission permission = permission_for(request);
  if (!is_permitted(viewer.who().role, permission, !host_.scene().tasks.empty()))
    return missing_permission(viewer.who().role, permission);
  if (permission == Permission::kOperateTool)
    if (const auto allowed = check_may_operate(viewer); !allowed) return allowed.error();
  if (const auto* play = std::get_if<PlayRequest>(&request.body)) return outcome_of(execute_play(*play));
  if (const auto* plan = std::get_if<PlanRequest>(&request.body)) return outcome_of(host_.change(*plan));
  if (const auto* lesson = std::get_if<LessonRequest>(&request.body))
    return outcome_of(execute_lesson(*lesson));
  if (const auto* pointer = std::get_if<PointerRequest>(&request.body))
    return outcome_of(execute_pointer(viewer, *pointer));
  if (live_ == nullptr) return read_only_error(host_);
  const auto set = [&](auto requested) {
    requested.by = viewer.identity();
    requested.id = request.id;
    return live_->set(requested);
  };
  if (const auto* settings = std::get_if<SettingsRequest>(&request.body)) return set(*settings);
  if (const auto* tissue = std::get_if<TissueRequest>(&request.body)) return set(*tissue);
  if (const auto* stroke = std::get_if<StrokeRequest>(&request.body)) return set(*stroke);
  if (const auto* task = std::get_if<TaskRequest>(&request.body))
    return outcome_of(execute_task(viewer, *task));
  return outcome_of(execute_rearm(viewer, std::get<RearmRequest>(request.body)));
}

// a learner may operate the tool only if the run is attributed to that learner
Result<void> Hub::check_may_operate(const Viewer& viewer) const {
  const AuthenticatedViewer& who = viewer.who();
  if (who.role != Role::kLearner) return {};
  const ViewedTraining training = host_.training();
  const bool is_run = training.phase == ViewedTraining::Phase::kRunning;
  if (state_.lesson.is_for(who.learner) && (!is_run || training.learner == who.learner)) return {};
  return Error{ErrorKind::kUsage,
               is_run ? "the run in progress belongs to another learner" : "it is another learner's turn",
               "learner",
               is_run ? "wait until it is over, or ask a teacher to end it" : "ask a teacher to choose you"};
}

// the viewer that moves the tip is the one being assessed; a teacher may begin a task without it
Result<void> Hub::execute_task(Viewer& viewer, TaskRequest request) {
  const AuthenticatedViewer& who = viewer.who();
  if (pointer_owner_ && pointer_owner_ != &viewer && !is_permitted(who.role, Permission::kLesson, true))
    return Error{ErrorKind::kUsage, "only the viewer that moves the tip can start and end a task", "",
                 "ask that viewer, or wait until the tip is released"};
  request.learner = who.learner;
  return live_->train(request);
}

Result<void> Hub::execute_lesson(const LessonRequest& request) {
  if (auto allowed = check_may_hand_over(request); !allowed) return allowed;
  if (request.learner || request.task || request.end) {
    if (live_ == nullptr) return Error{ErrorKind::kUsage, "a recording cannot be used for a lesson", "", ""};
    if (auto accepted = live_->teach(request); !accepted) return accepted;
  }
  are_hidden_names_shown_ = request.names.value_or(are_hidden_names_shown_);
  publish_state();
  // the named learner gets the pointer; a viewer that is no longer permitted loses it
  const std::string& named = request.pointer ? *request.pointer : request.learner.value_or("");
  if (request.pointer || !named.empty())
    hand_over_pointer(viewer_of_learner(named));
  else if (pointer_owner_ && !check_may_operate(*pointer_owner_))
    hand_over_pointer(nullptr);
  publish_state();
  return {};
}

// whether the pointer can be passed on as a teacher asks
Result<void> Hub::check_may_hand_over(const LessonRequest& request) const {
  if (!request.pointer) return {};
  if (live_ == nullptr || host_.scene().input != "pointer")
    return Error{ErrorKind::kUsage, "the tip of this session is not moved by a viewer", "pointer",
                 "start palpate explore with --device pointer"};
  const ViewedTraining training = host_.training();
  const bool is_run = training.phase == ViewedTraining::Phase::kRunning;
  const std::string& learner = is_run ? training.learner : request.learner.value_or(state_.lesson.learner);
  if (!request.pointer->empty() && !learner.empty() && learner != *request.pointer)
    return Error{ErrorKind::kUsage,
                 is_run ? "the run in progress belongs to another learner" : "it is another learner's turn",
                 "pointer", is_run ? "end it first" : "choose that learner for the lesson first"};
  if (!request.pointer->empty() && viewer_of_learner(*request.pointer) == nullptr)
    return Error{ErrorKind::kUsage, "no page of that learner is connected", "pointer",
                 "let the learner open the page and enter the token"};
  return {};
}

// Transfers the pointer to a viewer (null: to none). It is released first, so that the force fades out for
// the previous owner before it ramps in for the next one.
void Hub::hand_over_pointer(const Viewer* to) {
  if (pointer_owner_ == to) return;
  if (pointer_owner_) (void)live_->claim_pointer(false, pointer_owner_->identity());
  pointer_owner_ = nullptr;
  if (to != nullptr && host_.scene().input == "pointer" && live_->claim_pointer(true, to->identity()))
    pointer_owner_ = to;
}

// Viewer of a learner: the pointer's owner, or the most recent one; null: not connected.
const Viewer* Hub::viewer_of_learner(const std::string& learner) const {
  const Viewer* found = nullptr;
  for (const auto& viewer : viewers_) {
    if (!viewer->welcomed() || viewer->is_ending()) continue;
    if (viewer->who().role != Role::kLearner || viewer->who().learner != learner) continue;
    if (viewer.get() == pointer_owner_) return pointer_owner_;
    if (found == nullptr || viewer->identity().number > found->identity().number) found = viewer.get();
  }
  return found;
}

std::vector<ListedLearner> Hub::listed_learners() const {
  std::vector<ListedLearner> listed;
  for (std::string& learner : site_.access().learners()) {
    const Viewer* const page = viewer_of_learner(learner);
    listed.push_back({std::move(learner), page != nullptr, page != nullptr && page == pointer_owner_});
  }
  return listed;
}

// only the viewer that moves the tip can rearm the force
Result<void> Hub::execute_rearm(Viewer& viewer, RearmRequest request) {
  if (host_.scene().input == "pointer" && pointer_owner_ != &viewer)
    return Error{ErrorKind::kUsage, "only the viewer that moves the tip can rearm the force", "",
                 pointer_owner_ ? "ask that viewer, or wait until the tip is released"
                                : "take the pointer first (Touch), then rearm"};
  request.by = viewer.identity();
  return live_->rearm(request);
}

Result<void> Hub::execute_pointer(Viewer& viewer, const PointerRequest& request) {
  if (pointer_owner_ && pointer_owner_ != &viewer)
    return Error{ErrorKind::kUsage, "another viewer moves the tip", "take", "wait until the tip is released"};
  // releasing the pointer without having it changes nothing
  if (!request.take && !pointer_owner_) return {};
  if (live_ == nullptr) return read_only_error(host_);
  if (auto used = live_->claim_pointer(request.take, viewer.identity()); !used) return used;
  pointer_owner_ = request.take ? &viewer : nullptr;
  return {};
}

Result<void> Hub::execute_play(const PlayRequest& request) {
  if (PlaybackHost* const playback = host_.playback()) return playback->play(request);
  return Error{ErrorKind::kUsage, "this is a live session, not a recording", "",
               "palpate replay RECORDING --view shows one"};
}

void Hub::move_pointer(const Viewer& viewer, const TipMessage& tip) {
  // a viewer that has just lost the pointer may not know yet
  if (pointer_owner_ == &viewer) live_->move_pointer(tip.target);
}

std::uint32_t Hub::pointer_owner() const {
  return pointer_owner_ ? pointer_owner_->identity().number : 0;
}

}  // namespace palpate::server
