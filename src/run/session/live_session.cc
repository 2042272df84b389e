#include "session/live_session.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "palpate/base/check.h"
#include "palpate/palpation/logged_loop.h"
#include "palpate/palpation/plain_vectors.h"
#include "palpate/scene/named_values.h"
#include "session/refusal.h"
#include "session/setting_changes.h"
#include "session/viewed_scene.h"

namespace palpate {
namespace {

// minimum age of the health figures before they are computed again, independent of the number of callers;
// they cover the last second
constexpr auto kHealthPeriod = std::chrono::milliseconds(100);
// plausibility bound on a viewer's pointer position; distance from the volume's centre
constexpr double kMaxTipDistance_mm = 2000;

}  // namespace

LiveSession::LiveSession(LiveSessionParts parts)
    : parts_(std::move(parts)),
      stop_(loop_, physical()),
      model_(parts_.model, loop_),
      method_(model_, loop_, parts_.rebuild_fields, parts_.prepare_methods,
              [this](const Lock& lock) { return preparation_.wake(lock); }),
      law_(
          model_, loop_, parts_.devices.size(), parts_.prepare_law, parts_.solve_tissue,
          [this](const Lock& lock) { return preparation_.wake(lock); }, parts_.coarser_tissue),
      cutter_(model_, loop_),
      preparation_(model_, {&law_, &method_}),
      highest_max_force_N_(parts_.parameters.max_force_N) {}

void LiveSession::begin(ServoLoop& loop, const SessionStatistics& statistics) {
  statistics_ = &statistics;
  set_tip_holder({});
  loop_.connect(loop);
  stop_.begin();
  cutter_.begin(parts_.threads);
  law_.begin(parts_.threads);
}

bool LiveSession::run_step(std::chrono::steady_clock::time_point now) {
  cutter_.run_step(now);
  return law_.run_step(now);
}

void LiveSession::close() {
  is_closed_ = true;
  preparation_.end();
  cutter_.end();
  law_.end();
}

void LiveSession::end() {
  close();
  loop_.disconnect();
}

ServoLoop* LiveSession::commanded_loop() const {
  return is_closed_ ? nullptr : loop_.get();
}

// ---- state published to viewers

const ViewedScene& LiveSession::scene() const {
  std::call_once(scene_made_, [this] { scene_ = make_scene(); });
  return scene_;
}

ViewedScene LiveSession::make_scene() const {
  const Model& model = *parts_.model;
  ViewedScene scene = viewed_scene(model, parts_.devices.size(), parts_.modality);
  // choices and their ranges
  for (const ForceMethodInfo& info : kForceMethods)
    if (method_.is_choosable(info.method)) scene.methods.emplace_back(info.name);
  for (const auto& law : kTissueLaws)
    if (check_law(model, law.value)) scene.laws.emplace_back(law.name);
  const DeviceInfo& device = parts_.devices.front();
  scene.device_name = device.name;
  scene.simulated = !physical();
  scene.input = parts_.input;
  scene.peak_force_N = device.peak_force_N.value_or(kNoValue);
  scene.continuous_force_N = device.continuous_force_N.value_or(kNoValue);
  const double largest = parts_.parameters.device[0].max_stiffness_N_per_mm;
  scene.max_stiffness_N_per_mm = std::isfinite(largest) ? largest : kNoValue;
  scene.max_force_range = {kMaxForceRange.min, max_selectable_force_N()};
  scene.rate_hz = parts_.rate_hz;
  if (parts_.training != nullptr) scene.tasks = parts_.training->tasks();
  return scene;
}

bool LiveSession::physical() const {
  return std::any_of(parts_.devices.begin(), parts_.devices.end(),
                     [](const DeviceInfo& info) { return !info.simulated; });
}

double LiveSession::max_selectable_force_N() const {
  double max_N = std::min(kMaxForceRange.max, parts_.model->scene_max_force_N);
  for (const DeviceInfo& info : parts_.devices) max_N = std::min(max_N, info.peak_force_N.value_or(max_N));
  return max_N;
}

TickRecord LiveSession::snapshot(std::array<double, kMaxDevices>& stiffness_N_per_mm) const {
  stiffness_N_per_mm = {};
  const ServoLoop* loop = loop_.get();
  if (!loop) return {};
  const TickRecord tick = loop->snapshot();
  const Lock lock = model_.lock();
  for (std::size_t d = 0; d < static_cast<std::size_t>(tick.devices); ++d)
    stiffness_N_per_mm[d] = model_.rendered_stiffness_N_per_mm(lock, tick, d);
  return tick;
}

ViewedHealth LiveSession::health() const {
  ServoLoop* loop = loop_.get();
  if (!loop) return {};
  const std::lock_guard lock(health_mutex_);
  const auto now = std::chrono::steady_clock::now();
  if (now < health_until_) return health_;
  health_until_ = now + kHealthPeriod;
  const LoopHealth of_all = loop->health();
  const SessionStatistics::LastSecond last = statistics_->last_second();
  health_ = {rate_.observe(of_all.ticks), last.lateness_p50_us, last.lateness_p99_us, last.lateness_max_us,
             last.compute_p50_us,         of_all.skipped,       of_all.dropped,       of_all.stalls};
  // frees model versions that the loop no longer uses
  loop->collect();
  return health_;
}

ViewedState LiveSession::state() const {
  const ServoLoop* loop = loop_.get();
  const Parameters now = loop ? loop->parameters() : parts_.parameters;
  ViewedState state;
  static_cast<Settings&>(state) = now;
  state.motor_is_on = loop ? motor_was_on(*parts_.model, loop->snapshot()) : false;
  stop_.describe(state);
  if (parts_.training != nullptr) state.lesson = parts_.training->lesson();
  state.lesson.is_over = is_over_;
  state.recording = parts_.recording;
  const auto nearest_mm = loop ? statistics_->nearest_mm() : std::map<LabelId, double>();
  const Lock lock = model_.lock();
  state.model_version = model_.current(lock).version;
  state.tissues = viewed_tissues(model_.current(lock));
  method_.describe(lock, state);
  law_.describe(lock, state);
  cutter_.describe(lock, nearest_mm, state);
  return state;
}

std::shared_ptr<const Bricks<LabelId>> LiveSession::labels() const {
  return model_.current(model_.lock()).labels;
}

double LiveSession::highest_force_limit_N() const {
  const Lock lock = model_.lock();
  return highest_max_force_N_;
}

// ---- requests

bool LiveSession::cuts() const {
  return std::ranges::any_of(scene().tools, &ViewedTool::cuts);
}

Result<void> LiveSession::check(const Lock& lock, const SettingsRequest& request,
                                const Parameters& /*now*/) const {
  if (request.motor && !cuts()) return invalid_value("no device has a tool with a motor", "motor", "");
  if (request.method) {
    const auto method = find_force_method(*request.method);
    if (!method || !method_.is_choosable(*method))
      return invalid_value("this session has no force method with that name", "method",
                           "choose one of the scene's list");
    if (!method_.can_be_prepared(lock, *method)) return fields_for_other_stiffness();
  }
  if (request.law) {
    const auto law = std::ranges::find(kTissueLaws, *request.law, &NamedValue<TissueLaw>::name);
    if (law == kTissueLaws.end())
      return invalid_value("there is no soft-tissue law with that name", "law",
                           "choose one of the scene's list");
    if (auto fine = check_law(model_.current(lock), law->value); !fine)
      return refusal(fine.error().what, "law", fine.error().remedy);
  }
  if (request.max_force_N) {
    const double requested_N = *request.max_force_N, min_N = kMaxForceRange.min;
    if (!(requested_N >= min_N && requested_N <= max_selectable_force_N()))
      return invalid_value("a limit of " + rounded_text(requested_N) + " N is outside " +
                               rounded_text(min_N) + " ... " + rounded_text(max_selectable_force_N()) + " N",
                           "max_force_N", "the device and the scene allow no higher limit");
  }
  if (request.rotation_wxyz) {
    const double norm = quaternion(*request.rotation_wxyz).norm();
    if (!(norm > 0.5 && norm < 2))
      return invalid_value("the rotation is not a unit quaternion", "rotation_wxyz",
                           "send w, x, y, z of length 1");
  }
  return {};
}

Result<ModelChange> LiveSession::check(const Lock& lock, const TissueRequest& request,
                                       const Parameters& now) const {
  return model_.check(lock, request, now.method);
}

Result<void> LiveSession::check(const Lock& lock, const LastStrokeRequest& request,
                                const Parameters& now) const {
  if (!cuts()) return invalid_value("no device has a cutting tool", "", "");
  return cutter_.check(lock, request.change(), now);
}

// While force is enabled, the operator of a physical device has to consent to every change; while it is
// stopped, only to changes that could increase the force after re-arming.
bool LiveSession::needs_consent(bool could_increase_force) const {
  return physical() && (could_increase_force || !stop_.current());
}

template <class Request>
Result<RequestOutcome> LiveSession::request_consent(const Request& request, std::string what) {
  if (!parts_.has_operator)
    return refusal("the request cannot be confirmed while a device can apply force", "",
                   "start palpate in a terminal, where the operator can accept it");
  consent_.ask(request.by, request.id, std::move(what), [this, request]() -> Result<void> {
    ServoLoop* loop = commanded_loop();
    if (!loop) return not_running();
    const Lock lock = model_.lock();
    // the state may have changed while the question was pending
    if (auto fine = check(lock, request, loop->parameters()); !fine) return fine.error();
    return apply(lock, request, with_consent_of(request.by));
  });
  return RequestOutcome::kAwaitingConsent;
}

Result<RequestOutcome> LiveSession::set(const SettingsRequest& request) {
  ServoLoop* loop = commanded_loop();
  if (!loop) return not_running();
  const Lock lock = model_.lock();
  const Parameters now = loop->parameters();
  if (auto fine = check(lock, request, now); !fine) return fine.error();
  const SettingsRequest changed = changes_of(request, now, model_.current(lock).tissue_law,
                                             law_.is_pending(lock), method_.is_pending(lock));
  const std::string what = consent_text(changed, now);
  if (!what.empty() && needs_consent(could_increase_force(changed, now)))
    return request_consent(changed, what);
  if (auto applied = apply(lock, request, requested_by(request.by)); !applied) return applied.error();
  return RequestOutcome::kDone;
}

Result<void> LiveSession::apply(const Lock& lock, const SettingsRequest& request, RequestedBy by) {
  if (request.method)
    if (auto chosen = method_.choose(lock, *find_force_method(*request.method), by); !chosen) return chosen;
  if (request.law)
    if (auto chosen = law_.choose(lock, value_of(*request.law, kTissueLaws), by); !chosen) return chosen;
  if (request.max_force_N) highest_max_force_N_ = std::max(highest_max_force_N_, *request.max_force_N);
  change_logged(*loop_.get(), loop_.log(), by,
                [&](Parameters& parameters) { apply_changes(request, parameters); });
  return {};
}

Result<RequestOutcome> LiveSession::set(const TissueRequest& request) {
  ServoLoop* loop = commanded_loop();
  if (!loop) return not_running();
  const Lock lock = model_.lock();
  const auto change = check(lock, request, loop->parameters());
  if (!change) return change.error();
  const Tissue& tissue = model_.current(lock).tissues[static_cast<std::size_t>(request.tissue)];
  const ModelChange before = current_values(model_.current(lock), static_cast<std::size_t>(request.tissue));
  if (*change == before) return RequestOutcome::kDone;
  const bool more = std::ranges::any_of(kContactProperties, [&](const ContactProperty& property) {
    return change->contact.*property.value > before.contact.*property.value;
  });
  if (needs_consent(more))
    return request_consent(request, consent_text(tissue.name, before.contact, change->contact));
  if (auto applied = model_.edit(lock, *change, requested_by(request.by)); !applied) return applied.error();
  return RequestOutcome::kDone;
}

Result<void> LiveSession::apply(const Lock& lock, const TissueRequest& request, RequestedBy by) {
  const auto change = check(lock, request, loop_.get()->parameters());
  if (!change) return change.error();
  return model_.edit(lock, *change, by);
}

Result<RequestOutcome> LiveSession::set(const StrokeRequest& request) {
  ServoLoop* loop = commanded_loop();
  if (!loop) return not_running();
  const Lock lock = model_.lock();
  const LastStrokeRequest last_stroke{request, loop->strokes()};
  if (auto fine = check(lock, last_stroke, loop->parameters()); !fine) return fine.error();
  if (needs_consent(true))
    return request_consent(last_stroke, request.action == StrokeAction::kUndo
                                            ? "undo the last stroke: keep the " + cutter_name(*parts_.model) +
                                                  " out of the restored volume"
                                            : std::string("redo the last undone stroke"));
  if (auto applied = apply(lock, last_stroke, requested_by(request.by)); !applied) return applied.error();
  return RequestOutcome::kDone;
}

Result<void> LiveSession::apply(const Lock& lock, const LastStrokeRequest& request, RequestedBy by) {
  cutter_.request(lock, request.change(), by);
  return {};
}

// ---- keys at the device

Result<void> LiveSession::rearm_by_key(std::uint32_t stop) {
  if (rearmed_in_page())
    return refusal("a pointer can be rearmed only by the viewer that moves it", "",
                   "press Rearm in the page");
  return stop_.rearm(stop, {Originator::kKey});
}

void LiveSession::pause_by_key() {
  if (ServoLoop* loop = commanded_loop())
    change_logged(*loop, loop_.log(), {Originator::kKey},
                  [](Parameters& parameters) { parameters.paused = !parameters.paused; });
}

Result<void> LiveSession::toggle_motor_by_key() {
  ServoLoop* loop = commanded_loop();
  if (!loop) return not_running();
  if (!cuts()) return invalid_value("no device has a tool with a motor", "", "");
  change_logged(*loop, loop_.log(), {Originator::kKey},
                [](Parameters& parameters) { parameters.motor = !parameters.motor; });
  return {};
}

Result<void> LiveSession::change_stroke_by_key(StrokeAction action) {
  ServoLoop* loop = commanded_loop();
  if (!loop) return not_running();
  const Lock lock = model_.lock();
  const LastStrokeRequest request{{action, {}, 0}, loop->strokes()};
  if (auto fine = check(lock, request, loop->parameters()); !fine) return fine.error();
  return apply(lock, request, {Originator::kKey});
}

// ---- the pointer

Result<void> LiveSession::claim_pointer(bool take, const ViewerIdentity& by) {
  if (!parts_.pointer)
    return refusal("the tip is moved by the " + parts_.input + " here", "take",
                   "start palpate explore with --device pointer");
  ServoLoop* loop = commanded_loop();
  if (take && !loop) return not_running();
  const bool was_taken = pointer_claimed_.exchange(take);
  if (!take) parts_.pointer->release();
  set_tip_holder(take ? std::optional(by) : std::nullopt);
  if (loop && take != was_taken) log_pointer_change(*loop, loop_.log(), requested_by(by));
  return {};
}

// the first device performs the task: a pointer in another place moves a scope
void LiveSession::set_tip_holder(const std::optional<ViewerIdentity>& holder) {
  if (parts_.training != nullptr && parts_.pointer != nullptr &&
      parts_.devices.front().name == parts_.pointer->devices().front().name)
    parts_.training->set_tip_holder(holder);
}

void LiveSession::move_pointer(const std::optional<PointerTarget>& target) {
  const ServoLoop* loop = commanded_loop();
  if (!pointer_claimed_.load() || !loop) return;
  if (!target) return parts_.pointer->release();
  // pose of the object as currently rendered
  const Transform<World, Patient> X_WorldPatient =
      rotated_object_pose(parts_.model->X_WorldPatient, quaternion(loop->snapshot().rotation_applied_wxyz));
  const Point<Patient> tip_patient(target->tip_patient_mm[0], target->tip_patient_mm[1],
                                   target->tip_patient_mm[2]);
  const Point<World> tip = X_WorldPatient * tip_patient;
  // World's origin is the volume's centre. The negated comparison also rejects NaN.
  if (!(tip.eigen().norm() <= kMaxTipDistance_mm)) return;
  const WorkspaceMapping mapping(parts_.pointer->devices().front(), parts_.workspace);
  const Point<Device> tip_device = mapping.to_device(tip);
  PointerDriver::Press press;
  if (target->force_N != 0) {
    const Point<World> ahead =
        X_WorldPatient * (tip_patient + Vector<Patient>(target->into[0], target->into[1], target->into[2]));
    press = {(mapping.to_device(ahead) - tip_device).normalized(), target->force_N};
  }
  PALPATE_CHECK(parts_.pointer->move(tip_device, press, target->set_down).ok());
}

// ---- tasks

ViewedTraining LiveSession::training() const {
  return parts_.training != nullptr ? parts_.training->state() : ViewedTraining{};
}

std::shared_ptr<const ViewedDebriefing> LiveSession::debriefing() const {
  return parts_.training != nullptr ? parts_.training->debriefing() : nullptr;
}

Result<void> LiveSession::train(const TaskRequest& request) {
  if (parts_.training == nullptr) return LiveHost::train(request);
  // the evaluator gets ticks only while the loop runs
  if (commanded_loop() == nullptr) return not_running();
  return request.begin ? parts_.training->begin(*request.begin, request.learner) : parts_.training->end_run();
}

Result<void> LiveSession::teach(const LessonRequest& request) {
  if (request.learner || request.task) {
    if (parts_.training == nullptr)
      return refusal("there is no task for a lesson", "", "start palpate explore with --task");
    if (auto taught = parts_.training->teach(request); !taught) return taught;
  }
  if (request.end) is_over_ = true;
  return {};
}

Result<std::string> LiveSession::curves(const std::string& learner) const {
  return stores_runs() ? parts_.training->curves(learner) : LiveHost::curves(learner);
}

Result<void> LiveSession::begin_or_end_task_by_key() {
  if (parts_.training == nullptr)
    return refusal("there is no task to start", "", "start palpate explore with --task");
  if (commanded_loop() == nullptr) return not_running();
  return parts_.training->begin_or_end();
}

// ---- a tracked tool

std::optional<ViewedNavigation> LiveSession::navigation() const {
  const ServoLoop* loop = loop_.get();
  const auto tracked = std::ranges::find_if(parts_.devices, &DeviceInfo::in_patient);
  if (parts_.navigation == nullptr || tracked == parts_.devices.end() || loop == nullptr) return {};
  const auto number = static_cast<std::size_t>(tracked - parts_.devices.begin());
  const DeviceTick device = loop->snapshot().device[number];
  ViewedNavigation out{static_cast<int>(number),
                       (device.flags & (kFlagStale | kFlagDeviceFault)) == 0,
                       parts_.navigation->patient.fre_mm,
                       {}};
  const Point<Patient> tip(device.tip_patient_mm[0], device.tip_patient_mm[1], device.tip_patient_mm[2]);
  if (const auto error = error_of_tip(*parts_.navigation, tip))
    out.tip = ViewedNavigation::Error{error->rms_mm, error->max_mm, error->is_far};
  return out;
}

// ---- the plan

std::shared_ptr<const ViewedPlan> LiveSession::plan() const {
  return parts_.plan != nullptr ? parts_.plan->viewed() : nullptr;
}

Result<void> LiveSession::change(const PlanRequest& request) {
  return parts_.plan != nullptr ? parts_.plan->change(request) : LiveHost::change(request);
}

}  // namespace palpate
