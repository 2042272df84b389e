#include <algorithm>
#include <utility>
#include <vector>

#include "palpate/base/clock.h"
#include "server/hub.h"
#include "server/plan_json.h"
#include "server/task_json.h"
#include "server/viewer.h"

namespace palpate::server {
namespace {

// 15 Hz suffices for a smooth deformation, whose message can be as long as a hundred poses.
constexpr auto kDeformationPeriod = std::chrono::microseconds(66'600);
// numbers to be read by a person need no higher rate
constexpr auto kNavigationPeriod = std::chrono::milliseconds(100);
// the force display guides the user to hold a force within a band
constexpr auto kTrainingPeriod = std::chrono::milliseconds(50);
constexpr auto kPosePeriod =
    std::chrono::duration_cast<Hub::Clock::duration>(std::chrono::duration<double>(1 / kMaxPoses_hz));

}  // namespace

// ---- messages

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

}  // namespace palpate::server
