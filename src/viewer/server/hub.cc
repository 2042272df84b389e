#include "server/hub.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "palpate/base/clock.h"
#include "server/connection.h"
#include "server/plan_json.h"
#include "server/task_json.h"
#include "server/viewer.h"

namespace palpate::server {
namespace {

constexpr auto kHousekeepingPeriod = std::chrono::milliseconds(100);
// 15 Hz suffices for a smooth deformation, whose message can be as long as a hundred poses.
constexpr auto kDeformationPeriod = std::chrono::microseconds(66'600);
// numbers to be read by a person need no higher rate
constexpr auto kNavigationPeriod = std::chrono::milliseconds(100);
// the force display guides the user to hold a force within a band
constexpr auto kTrainingPeriod = std::chrono::milliseconds(50);
constexpr auto kShutdownTimeout = std::chrono::milliseconds(200);
// for viewers that still receive answers and results, over a slow network, too
constexpr auto kDeliveryTimeout = std::chrono::seconds(1);
constexpr auto kPosePeriod =
    std::chrono::duration_cast<Hub::Clock::duration>(std::chrono::duration<double>(1 / kMaxPoses_hz));

// roles with a reserved slot, however many viewers there are
bool has_reserved_slot(Role role) {
  return role == Role::kControl || role == Role::kTeacher;
}

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

Hub::Hub(EventLoop& loop, ViewerHost& host, Site& site, PayloadStore& volumes, PictureStore* pictures,
         DownloadRateLimiter downloads, FaultLog log, std::function<void(int)> on_viewer_count)
    : host_(host),
      live_(host.live()),
      site_(site),
      volumes_(volumes),
      pictures_(pictures),
      downloads_(downloads),
      log_(std::move(log)),
      on_viewer_count_(std::move(on_viewer_count)),
      loop_(loop),
      pose_timer_(loop.timer()),
      housekeeping_timer_(loop.timer()) {
  if (site.redaction() != nullptr) redacted_steps_.emplace(site.redaction()->scene());
}

Hub::~Hub() = default;

void Hub::begin() {
  schedule_housekeeping();
}

void Hub::end() {
  ended_ = true;
  pose_timer_->cancel();
  stop_when_delivered(Clock::now() + kDeliveryTimeout);
  for (const auto& connection : std::vector(connections_.begin(), connections_.end())) connection->close();
  // the state in which the session ended, and the results of a run that ended with it
  publish_state();
  publish_training(Clock::now());
  for (const auto& viewer : std::vector(viewers_.begin(), viewers_.end())) viewer->finish(kGoingAway);
  if (viewers_.empty()) loop_.stop();
}

// drops viewers that have not closed soon after their last message, or not received it by `latest`
void Hub::stop_when_delivered(Clock::time_point latest) {
  housekeeping_timer_->wait_until(Clock::now() + kShutdownTimeout, [this, latest] {
    const bool all_sent =
        std::ranges::all_of(viewers_, [](const auto& viewer) { return viewer->is_ending(); });
    if (all_sent || Clock::now() >= latest) return loop_.stop();
    stop_when_delivered(latest);
  });
}

// ---- connections

void Hub::add(std::shared_ptr<Connection> connection) {
  connections_.insert(std::move(connection));
}

void Hub::remove(const std::shared_ptr<Connection>& connection) {
  connections_.erase(connection);
}

void Hub::add(std::shared_ptr<Viewer> viewer) {
  viewers_.insert(std::move(viewer));
}

void Hub::remove(const std::shared_ptr<Viewer>& viewer) {
  if (viewers_.erase(viewer) == 0) return;
  if (viewer->welcomed() && live_ != nullptr) live_->forget(viewer->identity());
  if (pointer_owner_ == viewer.get()) {
    pointer_owner_ = nullptr;
    (void)live_->claim_pointer(false, viewer->identity());
  }
  if (viewer->welcomed()) update_viewer_count();
  if (ended_ && viewers_.empty()) loop_.stop();
}

bool Hub::has_single_downloader() const {
  return welcomed_ <= 1 && std::count_if(connections_.begin(), connections_.end(),
                                         [](const auto& connection) { return connection->is_loading(); }) <=
                               kDownloadsPerViewer;
}

DownloadRateLimiter::Chunk Hub::next_chunk(std::size_t left_bytes) {
  return downloads_.next(left_bytes, has_single_downloader(), Clock::now());
}

void Hub::make_room_for_connection() {
  if (connections_.empty() || connections_.size() + viewers_.size() < kMaxConnections) return;
  const auto rank = [](const auto& connection) {
    return std::pair(connection->phase(), connection->last_progress());
  };
  const auto oldest =
      std::min_element(connections_.begin(), connections_.end(),
                       [&](const auto& one, const auto& other) { return rank(one) < rank(other); });
  log_.add((*oldest)->peer(), "too many connections: this one, with the least progress, is closed");
  std::shared_ptr(*oldest)->close();
}

void Hub::drop_oldest_unauthenticated() {
  // a viewer that is closing occupies a slot while it waits for the close frame
  const auto ending =
      std::find_if(viewers_.begin(), viewers_.end(), [](const auto& viewer) { return viewer->is_ending(); });
  if (viewers_.size() >= kMaxViewers + kMaxUnauthenticated && ending != viewers_.end())
    std::shared_ptr(*ending)->remove_from_hub();
  std::shared_ptr<Viewer> oldest;
  std::size_t unauthenticated = 0;
  for (const auto& viewer : viewers_) {
    if (!viewer->is_silent()) continue;
    ++unauthenticated;
    if (!oldest || viewer->hello_by() < oldest->hello_by()) oldest = viewer;
  }
  if (unauthenticated >= kMaxUnauthenticated)
    oldest->end(kTryAgainLater, "too many viewers: a silent one is closed");
}

bool Hub::make_room_for_viewer(Role role) {
  std::shared_ptr<Viewer> latest;  // most recent one without control
  std::size_t all = 0, without_reserved_slot = 0;
  for (const auto& viewer : viewers_) {
    if (!viewer->welcomed() || viewer->is_ending()) continue;
    ++all;
    if (has_reserved_slot(viewer->who().role)) continue;
    ++without_reserved_slot;
    // the viewer that moves the tip is not dropped
    if (viewer.get() == pointer_owner_) continue;
    if (!latest || viewer->identity().number > latest->identity().number) latest = viewer;
  }
  if (!has_reserved_slot(role) && without_reserved_slot >= kMaxViewers - kReservedSlots) return false;
  if (all < kMaxViewers) return true;
  if (!has_reserved_slot(role) || !latest) return false;
  latest->end(kTryAgainLater, "gives its slot to a viewer with control or a teacher");
  return true;
}

void Hub::request_volume(const PayloadKey& key, std::function<void(PayloadStore::Payload)> then) {
  volumes_.request(key, [this, then = std::move(then)](PayloadStore::Payload payload) {
    loop_.post([then, payload = std::move(payload)] { then(payload); });
  });
}

void Hub::request_picture(PictureKey key, std::weak_ptr<const void> requester,
                          std::function<void(PictureStore::Payload)> then) {
  if (pictures_ == nullptr) return loop_.post([then = std::move(then)] { then(nullptr); });
  pictures_->request(std::move(key), std::move(requester),
                     [this, then = std::move(then)](PictureStore::Payload payload) mutable {
                       loop_.post([then = std::move(then), payload = std::move(payload)] { then(payload); });
                     });
}

void Hub::request_curves(const std::string& learner, std::function<void(Result<std::string>)> then) {
  volumes_.run([this, learner, then = std::move(then)] {
    Result<std::string> page = live_->curves(learner);
    loop_.post([then, page = std::move(page)] { then(page); });
  });
}

// ---- requests of viewers

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

std::string Hub::state_for(const Viewer& viewer) const {
  const Redaction* redaction = redaction_of(viewer);
  return state_json(redaction != nullptr ? redaction->of(state_) : state_,
                    {viewer.identity().number, viewer.who(), pointer_owner(), welcomed_,
                     are_hidden_names_shown_, redaction != nullptr,
                     viewer.who().role == Role::kTeacher ? listed_learners() : std::vector<ListedLearner>()});
}

std::string Hub::welcome_for(const AuthenticatedViewer& who) const {
  return welcome_json(who, !host_.scene().tasks.empty(), site_.stores_runs());
}

const Redaction* Hub::redaction_of(const Viewer& viewer) const {
  return site_.redaction_of(viewer.who());
}

const Redaction* Hub::active_redaction() const {
  return site_.redaction_of({Role::kLearner, ""});
}

const std::string& Hub::published_training(const Viewer& viewer) const {
  return redaction_of(viewer) != nullptr ? redacted_training_json_ : training_json_;
}

std::shared_ptr<const std::string> Hub::published_plan(const Viewer& viewer) const {
  return redaction_of(viewer) != nullptr ? nullptr : plan_json_;
}

std::shared_ptr<const std::string> Hub::published_debriefing(const Viewer& viewer) const {
  const bool is_own = viewed_debriefing_ && (viewer.who().role != Role::kLearner ||
                                             viewed_debriefing_->learner == viewer.who().learner);
  return is_own ? debriefing_json_ : nullptr;
}

// Active while the selected task is a quiz and, because any task may then be begun, while none is selected.
void Hub::update_redaction() {
  const auto& tasks = host_.scene().tasks;
  const auto chosen = std::ranges::find(tasks, state_.lesson.task, &ViewedTask::name);
  site_.set_redaction_active(!are_hidden_names_shown_ && (chosen == tasks.end() || chosen->quiz));
}

std::string Hub::sweeps_after(SentSweeps& sent) const {
  constexpr std::size_t kMaxAtOnce = 200;
  sent.count = std::min(sent.count, state_.sweeps);
  const std::vector<SweepRecord> next = host_.sweeps(
      state_.model_version, sent.count, std::min<std::uint64_t>(kMaxAtOnce, state_.sweeps - sent.count));
  // an empty list of sweeps makes the viewer drop those beyond `count`
  if (next.empty() && sent.shown == sent.count) return {};
  std::string text = sweeps_json(sent.count, next);
  sent.count += next.size();
  sent.shown = sent.count;
  return text;
}

// length of the common prefix of both sweep lists
std::uint64_t Hub::sweeps_in_common(const ViewedState& before, const ViewedState& now) {
  std::uint64_t smallest = std::min(before.sweeps, now.sweeps);
  // each undo between the two states shortens the common prefix to the length that it left
  const auto &more = before.undone_to.size() > now.undone_to.size() ? before : now,
             &less = &more == &before ? now : before;
  for (std::size_t n = less.undone_to.size(); n < more.undone_to.size(); ++n)
    smallest = std::min(smallest, more.undone_to[n]);
  return smallest;
}

void Hub::publish_state() {
  publish_plan();
  const ViewedState before = std::exchange(state_, host_.state());
  const std::uint64_t in_common = sweeps_in_common(before, state_);
  if (in_common < before.sweeps)
    for (const auto& viewer : viewers_) viewer->truncate_sweeps(in_common);
  update_redaction();
  // complete state, as for a teacher
  StateRecipient recipient;
  recipient.pointer_owner = pointer_owner();
  recipient.viewers = welcomed_;
  recipient.shows_hidden_names = are_hidden_names_shown_;
  recipient.learners = listed_learners();
  std::string text = state_json(state_, recipient), redacted_text;
  const Redaction* const redaction = active_redaction();
  recipient.redacted = redaction != nullptr;
  recipient.learners.clear();
  if (redaction != nullptr) redacted_text = state_json(redaction->of(state_), recipient);
  const bool is_new = text != last_state_json_, is_new_redacted = redacted_text != last_redacted_state_json_;
  last_state_json_ = std::move(text);
  last_redacted_state_json_ = std::move(redacted_text);
  // message timing carries information, too: a redacted viewer gets no message for changes that it must not
  // see
  for (const auto& viewer : viewers_)
    if (is_new_redacted || (is_new && redaction_of(*viewer) == nullptr)) viewer->notify_state();
}

void Hub::publish_plan() {
  auto plan = host_.plan();
  if (plan == plan_) return;
  plan_ = std::move(plan);
  plan_json_ = plan_ ? std::make_shared<const std::string>(plan_json(*plan_)) : nullptr;
  for (const auto& viewer : viewers_) viewer->notify_plan();
}

// ---- poses

void Hub::wait_for_poses() {
  // missed periods are not made up for
  next_pose_ = std::max(next_pose_ + kPosePeriod, Clock::now());
  pose_timer_->wait_until(next_pose_, [this] {
    if (ended_) return;
    if (welcomed_ == 0) {
      pose_timer_runs_ = false;
      return;
    }
    // schedule the next one first, whatever happens in this one
    wait_for_poses();
    publish_due();
  });
}

void Hub::publish_deformation(Clock::time_point now) {
  next_deformation_ = now + kDeformationPeriod;
  for (std::size_t device = 0; device < deformations_.size(); ++device) {
    LastPublished& found = deformations_[device];
    auto deformation = host_.deformation(device);
    if (found.message && deformation == found.deformation) continue;
    found.deformation = std::move(deformation);
    DeformationMessage next(device, found.deformation.get());
    if (found.message && next.is_indistinguishable_from(*found.message)) continue;
    found.published = {found.published.number + 1, next.rests(),
                       std::make_shared<const std::string>(next.bytes())};
    found.message = std::move(next);
  }
  for (const auto& viewer : viewers_) viewer->notify_deformation();
}

void Hub::publish_training(Clock::time_point now) {
  next_training_ = now + kTrainingPeriod;
  if (host_.scene().tasks.empty()) return;
  const ViewedTraining training = host_.training();
  std::string text = training_json(training), redacted_text;
  if (const Redaction* const redaction = active_redaction()) {
    redacted_steps_->follow(training);
    redacted_text = training_json(redaction->of(training, *redacted_steps_, redacted_tick_));
  }
  auto debriefed = host_.debriefing();
  const bool is_over = debriefed != viewed_debriefing_;
  if (is_over) {
    viewed_debriefing_ = std::move(debriefed);
    debriefing_json_ = viewed_debriefing_
                           ? std::make_shared<const std::string>(debriefing_json(*viewed_debriefing_))
                           : nullptr;
  }
  const bool is_new = text != training_json_ || is_over,
             is_new_redacted = redacted_text != redacted_training_json_ || is_over;
  training_json_ = std::move(text);
  redacted_training_json_ = std::move(redacted_text);
  for (const auto& viewer : viewers_)
    if (redaction_of(*viewer) != nullptr ? is_new_redacted : is_new) viewer->notify_training();
}

void Hub::publish_navigation(Clock::time_point now) {
  next_navigation_ = now + kNavigationPeriod;
  if (live_ == nullptr) return;
  const auto navigation = live_->navigation();
  if (!navigation) return;
  std::string text = navigation_json(*navigation);
  if (navigation_json_ && text == *navigation_json_) return;
  navigation_json_ = std::make_shared<const std::string>(std::move(text));
  for (const auto& viewer : viewers_) viewer->notify_navigation();
}

void Hub::publish_due() {
  const Clock::time_point now = Clock::now();
  if (now >= next_navigation_ && std::any_of(viewers_.begin(), viewers_.end(), [](const auto& viewer) {
        return viewer->receives_navigation();
      }))
    publish_navigation(now);
  if (now >= next_training_ && std::any_of(viewers_.begin(), viewers_.end(),
                                           [](const auto& viewer) { return viewer->receives_training(); }))
    publish_training(now);
  if (now >= next_deformation_ && std::any_of(viewers_.begin(), viewers_.end(), [](const auto& viewer) {
        return viewer->receives_deformation();
      }))
    publish_deformation(now);
  const auto due = [&](const auto& viewer) { return viewer->is_due(now); };
  if (std::none_of(viewers_.begin(), viewers_.end(), due)) return;
  std::array<double, kMaxDevices> stiffness_N_per_mm{};
  const std::int64_t clock_ns = monotonic_ns();
  const TickRecord tick = host_.snapshot(stiffness_N_per_mm);
  const PoseMessage pose(tick, stiffness_N_per_mm, health_, clock_ns);
  const DistanceMessage near(tick);
  struct Redacted {
    PoseMessage pose;
    DistanceMessage near;
    bool reports_distances;
  };
  std::optional<Redacted> redacted;
  for (const auto& viewer : viewers_) {
    if (!viewer->is_due(now)) continue;
    const Redaction* redaction = redaction_of(*viewer);
    if (redaction != nullptr && !redacted) {
      redacted_tick_ = redaction->of(tick);
      redacted_steps_->observe(redacted_tick_);
      redacted.emplace(Redacted{PoseMessage(redacted_tick_, {}, redaction->of(health_), clock_ns),
                                DistanceMessage(redacted_tick_), redaction->scene().reports_distances()});
    }
    const DistanceMessage& its_near = redaction != nullptr ? redacted->near : near;
    const bool reports_distances =
        redaction != nullptr ? redacted->reports_distances : host_.scene().reports_distances();
    viewer->enqueue_pose(redaction != nullptr ? redacted->pose : pose,
                         reports_distances ? &its_near : nullptr, now);
  }
}

// ---- periodic work

void Hub::schedule_housekeeping() {
  housekeeping_timer_->wait_until(Clock::now() + kHousekeepingPeriod, [this] {
    if (ended_) return;
    schedule_housekeeping();
    run_housekeeping();
  });
}

void Hub::run_housekeeping() {
  const Clock::time_point now = Clock::now();
  for (const auto& connection : std::vector(connections_.begin(), connections_.end())) connection->check(now);
  for (const auto& viewer : std::vector(viewers_.begin(), viewers_.end())) viewer->check(now);
  log_.catch_up(now);
  site_.access().forget_inactive_guesses(now);
  if (welcomed_ == 0) return;
  health_ = host_.health();
  deliver_late_answers();
  publish_state();
}

void Hub::deliver_late_answers() {
  if (live_ == nullptr) return;
  for (const LateAnswer& late : live_->read_answers())
    for (const auto& viewer : viewers_)
      if (viewer->identity().number == late.by.number && viewer->welcomed())
        viewer->send(late.outcome ? done_json(late.id) : refused_json(late.id, late.outcome.error()));
}

}  // namespace palpate::server
