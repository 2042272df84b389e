#include "session/live_session.h"
#include "palpate/base/spsc_ring.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <exception>
#include <numbers>
#include <system_error>

#include "palpate/base/reading.h"
#include "palpate/base/reason.h"
#include "palpate/device/felt_stiffness.h"
#include "palpate/palpation/logged_loop.h"
#include "palpate/palpation/plain_vectors.h"
#include "session/viewed_scene.h"

namespace palpate {
namespace {

// viewers poll with every pose, while the health figures cover the last second
constexpr auto kHealthPeriod = std::chrono::milliseconds(100);
// longest time that swept volume waits before the cutter thread removes it from the surfaces
constexpr auto kCutPoll = std::chrono::milliseconds(10);
constexpr int kLowestPriority = 19;
// plausibility bound on a viewer's pointer position; distance from the volume's centre
constexpr double kFarthestTip_mm = 2000;

Error bad(std::string what, std::string where, std::string remedy) {
  return {ErrorKind::kBadInput, std::move(what), std::move(where), std::move(remedy)};
}
Error refused(std::string what, std::string where, std::string remedy) {
  return {ErrorKind::kUsage, std::move(what), std::move(where), std::move(remedy)};
}
AskedBy agreed_to(const ViewerIdentity& viewer) {
  return {Asker::kAgreedViewer, viewer.number};
}
AskedBy asked_by(const ViewerIdentity& viewer) {
  return {viewer.control ? Asker::kControlViewer : Asker::kLookingViewer, viewer.number};
}
Error not_running() {
  return {ErrorKind::kUnavailable, "the session is not running yet", "", "try again in a moment"};
}

std::string number_text(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.4g", value);
  return text;
}

StoppedBy stopped_by(Asker asker) {
  switch (asker) {
    case Asker::kSession:
    case Asker::kScript:
      return StoppedBy::kSession;
    case Asker::kKey:
      return StoppedBy::kKey;
    case Asker::kControlViewer:
    case Asker::kLookingViewer:
    case Asker::kAgreedViewer:
      return StoppedBy::kViewer;
  }
  return StoppedBy::kSession;
}

Error made_for_others() {
  return refused("the fields of the direct methods were prepared for other stiffness values", "method",
                 "restore the initial stiffness of the tissues, or use inward ramps in the scene");
}
Error not_made(const std::exception& why) {
  return {ErrorKind::kUnavailable,
          std::string("the fields of the direct methods could not be prepared: ") + reason_of(why), "",
          "continue with the proxy, or close other programs to free memory"};
}

// force methods that viewers may choose, by index; a method that does not suit the volume is excluded
std::array<bool, kForceMethods.size()> choosable_methods(const Model& model) {
  std::array<bool, kForceMethods.size()> choosable{};
  // fields of the direct methods are not updated when a burr removes material
  for (const ForceMethodInfo& info : kDirectMethods)
    choosable[index_of(info.method)] = !model.cuts() && check_force_field(model, info.method).ok();
  choosable[index_of(ForceMethod::kProxy)] = model.has(ForceMethod::kProxy);
  return choosable;
}

// reduces a request to the settings that differ from the current ones
SettingsRequest changes_of(SettingsRequest request, const Parameters& now, TissueLaw law, bool law_is_awaited,
                           bool method_is_awaited) {
  const auto leave_out = [](auto& wanted, const auto& held) {
    if (wanted && *wanted == held) wanted.reset();
  };
  if (!method_is_awaited) leave_out(request.method, std::string(name_of(now.method)));
  if (!law_is_awaited) leave_out(request.law, std::string(name_of(law, kTissueLaws)));
  leave_out(request.friction, now.friction);
  leave_out(request.viscosity, now.viscosity);
  leave_out(request.passivity, now.passivity);
  leave_out(request.paused, now.paused);
  leave_out(request.motor, now.motor);
  leave_out(request.max_force_N, now.max_force_N);
  const Eigen::Quaterniond& q = now.rotation_target;
  leave_out(request.rotation_wxyz, std::array{q.w(), q.x(), q.y(), q.z()});
  return request;
}

// whether a setting could increase the force or release a restriction once the force is re-armed
bool feels_more(const SettingsRequest& wanted, const Parameters& now) {
  return (wanted.max_force_N && *wanted.max_force_N > now.max_force_N) || wanted.friction == true ||
         wanted.viscosity == true || wanted.passivity == false || wanted.paused == false ||
         wanted.motor == true || wanted.law.has_value();
}

/// Text of the consent question for a request: "pause the force, and turn the object by 20 degrees".
class Words {
 public:
  Words& add(const std::string& what) {
    text_ += (text_.empty() ? "" : ", and ") + what;
    return *this;
  }
  const std::string& text() const { return text_; }

 private:
  std::string text_;
};

std::string words_for(const SettingsRequest& wanted, const Parameters& now) {
  Words words;
  const auto switched = [&](const std::optional<bool>& on, const char* what) {
    if (on) words.add(std::string("switch ") + what + (*on ? " on" : " off"));
  };
  if (wanted.rotation_wxyz) {
    constexpr double kDegrees = 180 / std::numbers::pi;
    const double by = now.rotation_target.angularDistance(quaternion(*wanted.rotation_wxyz).normalized());
    words.add("turn the object by " + number_text(std::round(by * kDegrees * 10) / 10) + " degrees");
  }
  if (wanted.paused) words.add(*wanted.paused ? "pause the force" : "resume the force");
  if (wanted.max_force_N)
    words.add("set the force limit to " + number_text(*wanted.max_force_N) + " N, now " +
              number_text(now.max_force_N));
  if (wanted.method) words.add("use the method " + *wanted.method);
  if (wanted.law) words.add("use the soft-tissue law " + *wanted.law);
  switched(wanted.friction, "friction");
  switched(wanted.viscosity, "viscosity");
  switched(wanted.passivity, "the passivity controller");
  switched(wanted.motor, "the tool's motor");
  return words.text();
}

// names come from files: control characters are replaced so that none can move a terminal's cursor
std::string plain_name(std::string name) {
  for (char& c : name)
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = '?';
  return name;
}

std::string words_for(const std::string& tissue, const ContactProperties& before,
                      const ContactProperties& after) {
  Words words;
  for (const ContactProperty& property : kContactProperties) {
    const double from = before.*property.value, to = after.*property.value;
    if (from == to) continue;
    const std::string whose = words.text().empty() ? plain_name(tissue) + "'s " : std::string("its ");
    words.add("change " + whose + std::string(property.words) + " from " + number_text(from) + " to " +
              number_text(to) + (property.unit.empty() ? "" : " ") + std::string(property.unit));
  }
  return words.text();
}

}  // namespace

LiveSession::LiveSession(LiveSessionParts parts)
    : parts_(std::move(parts)),
      choosable_(choosable_methods(*parts_.model)),
      model_{parts_.model, parts_.model},
      removed_(*parts_.model),
      nearest_(*parts_.model),
      highest_max_force_N_(parts_.parameters.max_force_N) {
  const Model& model = *parts_.model;
  if (is_elastic(model.tissue_law))
    measured_cells_of(model.tissue_law) = {model.tissue_coarsened, parts_.coarser_tissue};
}

void LiveSession::begin(ServoLoop& loop, const ExploreWatch& watch) {
  watch_ = &watch;
  loop_.store(&loop);
  const std::lock_guard lock(stop_mutex_);
  if (stopped_early_.load()) stop_logged(loop, told_, stopped_by_);
  if (parts_.model->cuts()) cutter_ = std::thread([this] { run_cutter(); });
  const std::lock_guard its_model(mutex_);
  if (is_moving(model_.felt->tissue_law)) start_tissue_thread(loop);
}

// the thread keeps running, idle, when a law without moving tissue is selected later
void LiveSession::start_tissue_thread(ServoLoop& loop) {
  if (tissue_ != nullptr || ending_.load() || !model_.felt->has(ForceMethod::kProxy)) return;
  tissue_ = std::make_unique<TissueThread>(loop, told_, [this] {
    const std::lock_guard its_model(mutex_);
    return model_.felt;
  });
  yields_.store(tissue_.get());
}

// takes effect immediately unless surfaces have to be built or the solver's cell size has to be measured
Result<void> LiveSession::change_law(TissueLaw law, AskedBy by, ServoLoop& loop) {
  law_failure_.reset();
  if (law == model_.felt->tissue_law) {
    law_awaited_.reset();
    script_law_led_to_ = model_.felt->version;
    return {};
  }
  if (auto fine = check_law(*model_.felt, law); !fine) return fine.error();
  const bool is_carried = !is_elastic(law) || measured_cells_of(law).coarsened > 0;
  if (!has_other_surfaces(*model_.felt, law) && is_carried) {
    auto under = under_law(*model_.felt, law);
    if (!under) return under.error();
    go_by(**under, is_elastic(law) ? measured_cells_of(law).coarsened : 0, by, loop);
    return {};
  }
  if (auto started = start_maker(); !started) return started;
  law_awaited_ = law;
  law_awaited_by_ = by;
  wanted_.notify_one();
  return {};
}

// switches the current model version to the law of `under`
void LiveSession::go_by(const Model& under, double coarsened, AskedBy by, ServoLoop& loop) {
  const ModelChange change = change_of_law(*model_.felt, under.tissue_law, coarsened);
  if (is_moving(under.tissue_law)) start_tissue_thread(loop);
  apply_version({with_law(*model_.felt, under, change), model_.made}, change, by, loop);
  law_awaited_.reset();
  script_law_led_to_ = change.version;
}

void LiveSession::change_law_by_script(TissueLaw law) {
  ServoLoop* loop = loop_.load();
  const std::lock_guard lock(mutex_);
  script_law_led_to_.reset();
  // a law that the script may not use was rejected when the script was read; a viewer may have cut since
  if (!loop || !change_law(law, {Asker::kScript}, *loop)) script_law_led_to_ = 0;
}

// runs on the maker thread
void LiveSession::prepare_law(std::unique_lock<std::mutex>& lock, const Progress& progress) {
  const std::shared_ptr<const Model> of = model_.felt;
  const TissueLaw law = *law_awaited_;
  // unlock: a thread waiting for the mutex would inherit this thread's low priority as latency
  lock.unlock();
  const auto made = [&]() -> Result<MeasuredCells> {
    try {
      return parts_.other_law(*of, law, parts_.devices.size(), progress);
    } catch (const std::exception& why) {
      return Error{ErrorKind::kUnavailable,
                   std::string("the surfaces of soft tissue could not be prepared: ") + reason_of(why), "",
                   "continue with this law, or close other programs to free memory"};
    }
  }();
  lock.lock();
  // the request may have been replaced or withdrawn; surfaces built for an older model version do not fit
  if (ending_ || law_awaited_ != law || model_.felt != of) return;
  if (!made) return abandon_law(made.error());
  const double coarsened = is_elastic(law) ? made->model->tissue_coarsened : 0;
  go_by(*made->model, coarsened, law_awaited_by_, *loop_.load());
  if (!is_elastic(law)) return;
  if (measured_cells_of(law).coarsened == 0 && !made->told.empty()) later_coarser_.push_back(made->told);
  measured_cells_of(law) = {coarsened, made->told};
}

// keeps the current law and reports the error to whoever requested the change
void LiveSession::abandon_law(Error why) {
  why.where = name_of(*law_awaited_, kTissueLaws);
  law_awaited_.reset();
  law_failure_ = std::move(why);
  script_law_led_to_ = 0;
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
    if (is_choosable(info.method)) scene.methods.emplace_back(info.name);
  for (const auto& law : kTissueLaws)
    if (check_law(model, law.value)) scene.laws.emplace_back(law.name);
  const DeviceInfo& device = parts_.devices.front();
  scene.device_name = device.name;
  scene.simulated = !physical();
  scene.input = parts_.input;
  scene.peak_force_N = device.peak_force_N.value_or(kNotKnown);
  scene.continuous_force_N = device.continuous_force_N.value_or(kNotKnown);
  const double most = parts_.parameters.device[0].max_stiffness_N_per_mm;
  scene.max_stiffness_N_per_mm = std::isfinite(most) ? most : kNotKnown;
  scene.min_max_force_N = max_force_range_N()[0];
  scene.max_max_force_N = most_force_N();
  scene.stiffness_N_per_mm = tissue_key_range("stiffness");
  scene.friction = tissue_key_range("friction");
  scene.rate_hz = parts_.rate_hz;
  if (parts_.training != nullptr) scene.tasks = parts_.training->tasks();
  return scene;
}

bool LiveSession::physical() const {
  return std::any_of(parts_.devices.begin(), parts_.devices.end(),
                     [](const DeviceInfo& info) { return !info.simulated; });
}

double LiveSession::most_force_N() const {
  double max_N = std::min(max_force_range_N()[1], parts_.model->scene_max_force_N);
  for (const DeviceInfo& info : parts_.devices) max_N = std::min(max_N, info.peak_force_N.value_or(max_N));
  return max_N;
}

// Stiffness that this tick rendered. The proxy scales each tissue by itself; a direct method scales all
// tissues by one factor.
double LiveSession::felt_stiffness_N_per_mm(const TickRecord& tick, std::size_t number) const {
  const DeviceTick& device = tick.device[number];
  const auto method = static_cast<ForceMethod>(tick.method);
  const RenderedStiffness gains(device);
  const Model &felt = *model_.felt, &made = *model_.made;
  const Tissue* tissue = felt.tissue_of(device.label);
  if (device.label == 0 || !tissue) return 0;
  const bool by_proxy = method == ForceMethod::kProxy && felt.has(method);
  if (by_proxy && felt.is_deformable(*tissue)) return yielding_stiffness_N_per_mm(device);
  if (by_proxy) return gains.by_proxy(tissue->stiffness_N_per_mm);
  // the fields encode the stiffnesses that they were generated for
  const double stiffest = felt.greatest_stiffness_N_per_mm();
  const double own = made.tissue_of(device.label)->stiffness_N_per_mm;
  const double left = std::min(1.0, stiffest / made.greatest_stiffness_N_per_mm());
  const double all_points = stiffest * static_cast<double>(felt.tool_of(number).points_mm.size());
  return gains.at_device(own * left * gains.direct_method_factor(all_points));
}

TickRecord LiveSession::snapshot(std::array<double, kMaxDevices>& stiffness_N_per_mm) const {
  stiffness_N_per_mm = {};
  const ServoLoop* loop = loop_.load();
  if (!loop) return {};
  const TickRecord tick = loop->snapshot();
  const std::lock_guard lock(mutex_);
  for (std::size_t d = 0; d < static_cast<std::size_t>(tick.devices); ++d)
    stiffness_N_per_mm[d] = felt_stiffness_N_per_mm(tick, d);
  return tick;
}

ViewedHealth LiveSession::health() const {
  ServoLoop* loop = loop_.load();
  if (!loop) return {};
  const std::lock_guard lock(health_mutex_);
  const auto now = std::chrono::steady_clock::now();
  if (now < health_until_) return health_;
  health_until_ = now + kHealthPeriod;
  const LoopHealth of_all = loop->health();
  const ExploreWatch::LastSecond last = watch_->last_second();
  health_ = {rate_.see(of_all.ticks), last.lateness_p50_us, last.lateness_p99_us, last.lateness_max_us,
             last.compute_p50_us,     of_all.skipped,       of_all.dropped,       of_all.stalls};
  // frees model versions that the loop no longer uses
  loop->collect();
  return health_;
}

ViewedState LiveSession::state() const {
  const ServoLoop* loop = loop_.load();
  const Parameters now = loop ? loop->parameters() : parts_.parameters;
  ViewedState state;
  state.method = name_of(now.method);
  state.friction = now.friction;
  state.viscosity = now.viscosity;
  state.passivity = now.passivity;
  state.paused = now.paused;
  state.motor = now.motor;
  state.motor_is_on = loop ? motor_was_on(*parts_.model, loop->snapshot()) : false;
  {
    const std::lock_guard lock(stop_mutex_);
    state.stop = current_stop();
    state.stopped_by = stopped_by(stopped_by_.asker);
    state.stopped_by_viewer = stopped_by_.viewer;
  }
  state.max_force_N = now.max_force_N;
  const Eigen::Quaterniond& q = now.rotation_target;
  state.rotation_wxyz = {q.w(), q.x(), q.y(), q.z()};
  state.armed = physical() && loop && !state.stop;
  if (parts_.training != nullptr) state.lesson = parts_.training->lesson();
  state.recording = parts_.recording;
  const std::lock_guard lock(mutex_);
  if (awaited_) state.method_awaited = name_of(*awaited_);
  state.method_failure = method_failure_;
  state.model_version = model_.felt->version;
  state.law = name_of(model_.felt->tissue_law, kTissueLaws);
  if (law_awaited_) state.law_awaited = name_of(*law_awaited_, kTissueLaws);
  state.law_failure = law_failure_;
  state.sweeps = cuts_.count(model_.felt->version);
  state.undone_to = cuts_.undone_to(model_.felt->version);
  if (const Carving* const carving = model_.felt->carving.get()) {
    state.strokes_to_undo = carving->strokes_to_undo();
    state.strokes_to_redo = carving->strokes_to_redo();
  }
  state.removed_mm3 = removed_.by_label_mm3();
  NearestMeter nearest = nearest_;
  if (loop) nearest.see(watch_->nearest_mm());
  state.nearest_mm = nearest.nearest_mm();
  state.tissues = viewed_tissues(*model_.felt);
  return state;
}

std::shared_ptr<const Bricks<LabelId>> LiveSession::labels() const {
  const std::lock_guard lock(mutex_);
  return model_.felt->labels;
}

std::shared_ptr<const ViewedYield> LiveSession::yielded(std::size_t device) const {
  const TissueThread* const tissue = yields_.load();
  return tissue != nullptr ? tissue->yielded(device) : nullptr;
}

std::optional<ForceMethod> LiveSession::method_awaited() const {
  const std::lock_guard lock(mutex_);
  return awaited_;
}

std::optional<Error> LiveSession::method_failure() const {
  const std::lock_guard lock(mutex_);
  return method_failure_;
}

std::optional<std::uint32_t> LiveSession::script_law_version() const {
  const std::lock_guard lock(mutex_);
  return script_law_led_to_;
}

std::string LiveSession::coarser_tissue() const {
  const std::lock_guard lock(mutex_);
  return measured_cells_of(model_.felt->tissue_law).told;
}

std::vector<std::string> LiveSession::later_coarser_tissue() const {
  const std::lock_guard lock(mutex_);
  return later_coarser_;
}

double LiveSession::highest_max_force_N() const {
  const std::lock_guard lock(mutex_);
  return highest_max_force_N_;
}

// ---- requests

bool LiveSession::cuts() const {
  return std::ranges::any_of(scene().tools, &ViewedTool::cuts);
}

bool LiveSession::is_available(ForceMethod method) const {
  if (!is_choosable(method)) return false;
  return model_.felt->has(method) &&
         (method == ForceMethod::kProxy || fields_match(*model_.felt, *model_.made));
}

// whether the method is available now or its fields can be generated
bool LiveSession::can_be_prepared(ForceMethod method) const {
  return is_available(method) || fields_match(*model_.felt, *model_.made) || can_make_fields(*model_.felt);
}

Result<void> LiveSession::check(const SettingsRequest& request, const Parameters& /*now*/) const {
  if (request.motor && !cuts()) return bad("no device has a tool with a motor", "motor", "");
  if (request.method) {
    const auto method = find_force_method(*request.method);
    if (!method || !is_choosable(*method))
      return bad("this session has no force method with that name", "method",
                 "choose one of the scene's list");
    if (!can_be_prepared(*method)) return made_for_others();
  }
  if (request.law) {
    const auto law = std::ranges::find(kTissueLaws, *request.law, &Word<TissueLaw>::name);
    if (law == kTissueLaws.end())
      return bad("there is no soft-tissue law with that name", "law", "choose one of the scene's list");
    if (auto fine = check_law(*model_.felt, law->value); !fine)
      return refused(fine.error().what, "law", fine.error().remedy);
  }
  if (request.max_force_N) {
    const double asked_N = *request.max_force_N, min_N = max_force_range_N()[0];
    if (!(asked_N >= min_N && asked_N <= most_force_N()))
      return bad("a limit of " + number_text(asked_N) + " N is outside " + number_text(min_N) + " ... " +
                     number_text(most_force_N()) + " N",
                 "max_force_N", "the device and the scene allow no higher limit");
  }
  if (request.rotation_wxyz) {
    const double norm = quaternion(*request.rotation_wxyz).norm();
    if (!(norm > 0.5 && norm < 2))
      return bad("the rotation is not a unit quaternion", "rotation_wxyz", "send w, x, y, z of length 1");
  }
  return {};
}

// While force is enabled, the operator of a physical device has to consent to every change; while it is
// stopped, only to changes that could increase the force after re-arming.
bool LiveSession::wants_consent(bool feels_more) const {
  return physical() && (feels_more || !current_stop());
}

template <class Request>
Result<Grant> LiveSession::ask(const Request& request, std::string what) {
  if (!parts_.asks_here)
    return refused("the request cannot be confirmed while a device may give force", "",
                   "start palpate in a terminal, where the operator can accept it");
  consent_.ask(request.by, request.id, std::move(what), [this, request]() -> Result<void> {
    ServoLoop* loop = loop_.load();
    if (!loop) return not_running();
    const std::lock_guard lock(mutex_);
    // the state may have changed while the question was pending
    if (auto fine = check(request, loop->parameters()); !fine) return fine.error();
    return apply(request, agreed_to(request.by));
  });
  return Grant::kAsked;
}

Result<Grant> LiveSession::set(const SettingsRequest& request) {
  ServoLoop* loop = loop_.load();
  if (!loop) return not_running();
  const std::lock_guard lock(mutex_);
  const Parameters now = loop->parameters();
  if (auto fine = check(request, now); !fine) return fine.error();
  const SettingsRequest wanted =
      changes_of(request, now, model_.felt->tissue_law, law_awaited_.has_value(), awaited_.has_value());
  const std::string what = words_for(wanted, now);
  if (!what.empty() && wants_consent(feels_more(wanted, now))) return ask(wanted, what);
  if (auto applied = apply(request, asked_by(request.by)); !applied) return applied.error();
  return Grant::kDone;
}

Result<void> LiveSession::apply(const SettingsRequest& request, AskedBy by) {
  ServoLoop& loop = *loop_.load();
  if (request.method)
    if (auto chosen = choose(*find_force_method(*request.method), by, loop); !chosen) return chosen;
  if (request.law)
    if (auto changed = change_law(value_of(*request.law, kTissueLaws), by, loop); !changed) return changed;
  if (request.max_force_N) highest_max_force_N_ = std::max(highest_max_force_N_, *request.max_force_N);
  change_logged(loop, told_, by, [&](Parameters& parameters) {
    if (request.friction) parameters.friction = *request.friction;
    if (request.viscosity) parameters.viscosity = *request.viscosity;
    if (request.passivity) parameters.passivity = *request.passivity;
    if (request.paused) parameters.paused = *request.paused;
    if (request.motor) parameters.motor = *request.motor;
    if (request.max_force_N) parameters.max_force_N = *request.max_force_N;
    if (request.rotation_wxyz) parameters.rotation_target = quaternion(*request.rotation_wxyz).normalized();
  });
  return {};
}

Result<void> LiveSession::check_stiffness_change(double from_N_per_mm, double to_N_per_mm,
                                                 ForceMethod method) const {
  if (to_N_per_mm == from_N_per_mm) return {};
  if (method != ForceMethod::kProxy || !model_.felt->has(method))
    return refused(
        "the field that " + std::string(name_of(method)) + " reads was prepared for the current stiffness",
        "stiffness_N_per_mm", "choose the proxy, which applies a new stiffness at once");
  return {};
}

// returns the resulting change; it may be empty
Result<ModelChange> LiveSession::check(const TissueRequest& request, const Parameters& now) const {
  if (request.tissue < 0 || static_cast<std::size_t>(request.tissue) >= model_.felt->tissues.size())
    return bad("there is no such tissue", "tissue", "tissues are numbered from 0, in the order of the scene");
  const ModelChange before = unchanged(*model_.felt, static_cast<std::size_t>(request.tissue));
  ModelChange change = before;
  change.contact = request.changes.applied_to(before.contact);
  if (change == before) return change;
  const Tissue& tissue = model_.felt->tissues[static_cast<std::size_t>(request.tissue)];
  if (model_.felt->is_deformable(tissue) &&
      change.contact.stiffness_N_per_mm != before.contact.stiffness_N_per_mm)
    return refused("this tissue yields, and its stiffness follows from its Young's modulus",
                   "stiffness_N_per_mm", "change youngs_modulus in the scene file, and open it again");
  if (auto next = changed_model(*model_.felt, *model_.made, change); !next) return next.error();
  if (auto fine = check_stiffness_change(before.contact.stiffness_N_per_mm, change.contact.stiffness_N_per_mm,
                                         now.method);
      !fine)
    return fine.error();
  return change;
}

Result<Grant> LiveSession::set(const TissueRequest& request) {
  ServoLoop* loop = loop_.load();
  if (!loop) return not_running();
  const std::lock_guard lock(mutex_);
  const auto change = check(request, loop->parameters());
  if (!change) return change.error();
  const Tissue& tissue = model_.felt->tissues[static_cast<std::size_t>(request.tissue)];
  const ModelChange before = unchanged(*model_.felt, static_cast<std::size_t>(request.tissue));
  if (*change == before) return Grant::kDone;
  const bool more = std::ranges::any_of(kContactProperties, [&](const ContactProperty& property) {
    return change->contact.*property.value > before.contact.*property.value;
  });
  if (wants_consent(more)) return ask(request, words_for(tissue.name, before.contact, change->contact));
  if (auto applied = apply(request, asked_by(request.by)); !applied) return applied.error();
  return Grant::kDone;
}

Result<void> LiveSession::apply(const TissueRequest& request, AskedBy by) {
  ServoLoop& loop = *loop_.load();
  const auto change = check(request, loop.parameters());
  if (!change) return change.error();
  auto next = changed_model(*model_.felt, *model_.made, *change);
  if (!next) return next.error();
  apply_version({*std::move(next), model_.made}, *change, by, loop);
  return {};
}

// strokes that can still be undone or redone once the queued requests have been carried out
std::ptrdiff_t LiveSession::strokes_left(StrokeAction action) const {
  const Carving* const carving = model_.felt->carving.get();
  if (carving == nullptr) return 0;
  auto left = static_cast<std::ptrdiff_t>(action == StrokeAction::kUndo ? carving->strokes_to_undo()
                                                                        : carving->strokes_to_redo());
  for (const WantedStroke& wanted : strokes_wanted_) left += wanted.action == action ? -1 : 1;
  return left;
}

Result<void> LiveSession::check(const LastStrokeRequest& request, const Parameters& now) const {
  if (!cuts()) return bad("no device has a cutting tool", "", "");
  const ServoLoop& loop = *loop_.load();
  if (now.motor || motor_was_on(*parts_.model, loop.snapshot()))
    return refused("the motor is running, and the stroke is not finished", "motor",
                   "switch off the motor, or release its pedal, first");
  if (loop.strokes() != request.strokes)
    return refused("another stroke was started after the request", "", "repeat the request for that stroke");
  if (strokes_left(request.action) > 0) return {};
  return request.action == StrokeAction::kUndo
             ? refused("there is no stroke to undo", "",
                       "a stroke is everything cut between start and stop of the motor; the last " +
                           std::to_string(kMaxUndoneStrokes) + " are kept")
             : refused("there is no stroke to redo", "", "cutting after an undo discards the undone strokes");
}

Result<Grant> LiveSession::set(const StrokeRequest& request) {
  ServoLoop* loop = loop_.load();
  if (!loop) return not_running();
  const std::lock_guard lock(mutex_);
  const LastStrokeRequest wanted{request, loop->strokes()};
  if (auto fine = check(wanted, loop->parameters()); !fine) return fine.error();
  if (wants_consent(true))
    return ask(wanted, request.action == StrokeAction::kUndo
                           ? "undo the last stroke: keep the " + cutter_name(*parts_.model) + " out of it"
                           : std::string("redo the last undone stroke"));
  if (auto applied = apply(wanted, asked_by(request.by)); !applied) return applied.error();
  return Grant::kDone;
}

Result<void> LiveSession::apply(const LastStrokeRequest& request, AskedBy by) {
  strokes_wanted_.push_back({request.action, by, request.strokes});
  return {};
}

void LiveSession::change_stroke_by_script(StrokeAction action) {
  ServoLoop* loop = loop_.load();
  const std::lock_guard lock(mutex_);
  script_stroke_led_to_ = 0;
  if (!loop || !parts_.model->cuts()) return;
  strokes_wanted_.push_back({action, {Asker::kScript}, loop->strokes()});
  script_stroke_led_to_.reset();
}

std::optional<std::uint32_t> LiveSession::script_stroke_version() const {
  const std::lock_guard lock(mutex_);
  return script_stroke_led_to_;
}

// strong exception guarantee: either both the loop and model_ change or neither does
void LiveSession::apply_version(ModelVersions next, const ModelChange& change, AskedBy by, ServoLoop& loop) {
  set_model_logged(loop, told_, by, next.felt, change);
  model_ = std::move(next);
}

// ---- material removal by a burr

void LiveSession::run_cutter() {
  ServoLoop& loop = *loop_.load();
  std::array<SweepRecord, 64> swept;
  std::vector<Cut> cuts;
  while (!ending_.load()) try {
      std::this_thread::sleep_for(kCutPoll);
      // sampled before the sweeps are popped, so that the sweeps of a stroke that had ended by then are
      // complete
      const bool stroke_is_over = !motor_was_on(*parts_.model, loop.snapshot());
      for (std::size_t count = loop.sweeps().pop(swept); count > 0; count = loop.sweeps().pop(swept))
        for (const SweepRecord& sweep : std::span(swept).first(count)) cuts.push_back(cut_of(sweep));
      if (!cuts.empty()) cut(cuts, loop);
      cuts.clear();
      if (stroke_is_over) change_strokes(loop);
    } catch (const std::exception&) {
      // Out of memory: the burr waits for its sweeps to be removed and cuts nothing meanwhile. No stroke is
      // undone.
    }
}

// Only this thread cuts, so `before` already contains every earlier cut. The mutex is not locked while
// carving.
void LiveSession::cut(std::span<const Cut> cuts, ServoLoop& loop) {
  std::shared_ptr<const Model> before;
  {
    const std::lock_guard lock(mutex_);
    before = model_.felt;
  }
  auto carving = carved_by(*before, cuts);
  const std::lock_guard lock(mutex_);
  // the law may have changed meanwhile and brought new surfaces, from which these cuts are still missing
  if (has_other_surfaces(*before, model_.felt->tissue_law)) carving = carved_by(*model_.felt, cuts);
  // operations that may throw come first; repeating them is harmless
  cuts_.reserve(cuts.size());
  for (const Cut& cut : cuts) nearest_.see(cut.sweep);
  removed_.add(cuts);
  auto next = carving->taken_from(*model_.felt);
  set_cut_model_logged(loop, told_, cuts, next);
  model_.felt = std::move(next);
  for (const Cut& cut : cuts) cuts_.add(model_.felt->version, plain(cut));
}

// Runs on the cutter thread as well, so that no cut happens concurrently.
void LiveSession::change_strokes(ServoLoop& loop) {
  const std::lock_guard lock(mutex_);
  while (!strokes_wanted_.empty()) {
    const WantedStroke wanted = strokes_wanted_.front();
    strokes_wanted_.pop_front();
    const bool by_script = wanted.by.asker == Asker::kScript;
    if (by_script) script_stroke_led_to_ = 0;
    // a stroke has begun since the request, so the request does not refer to the last one
    if (wanted.strokes != loop.strokes()) continue;
    const ModelChange change = change_of_stroke(*model_.felt, wanted.action);
    cuts_.reserve(0);
    auto next = next_version(model_, change);
    if (!next) continue;
    apply_version(*std::move(next), change, wanted.by, loop);
    if (by_script) script_stroke_led_to_ = change.version;
    cuts_.add(change.version, wanted.action);
    follow(change, removed_);
  }
}

std::vector<SweepRecord> LiveSession::sweeps(std::uint32_t version, std::uint64_t first,
                                             std::size_t most) const {
  const std::lock_guard lock(mutex_);
  return cuts_.by(version, static_cast<std::size_t>(first), most);
}

void LiveSession::emergency_stop(const ViewerIdentity& by) {
  stop(asked_by(by));
}

void LiveSession::stop_here() {
  stop({Asker::kKey});
}

void LiveSession::stop(AskedBy by) {
  const std::lock_guard lock(stop_mutex_);
  stopped_by_ = by;
  if (ServoLoop* loop = loop_.load()) return stop_logged(*loop, told_, by);
  stopped_early_.store(true);
}

std::optional<std::uint32_t> LiveSession::current_stop() const {
  const ServoLoop* loop = loop_.load();
  const Arming arming = loop ? loop->arming() : Arming{0, stopped_early_.load()};
  return arming.stopped ? std::optional(arming.number) : std::nullopt;
}

Result<void> LiveSession::rearm(const RearmRequest& request) {
  if (physical() && request.code.empty())
    return refused("a force-feedback device must be rearmed at the device, not remotely", "",
                   "press r at the terminal of palpate with the tip free, or enter the code shown there");
  if (physical() && !arming_code_.take(request.stop, request.code))
    return refused("the code differs from the one shown at the terminal of palpate", "code",
                   "each code is valid once, for a minute and for the last stop: enter the current one");
  return rearm(request.stop, asked_by(request.by));
}

std::string LiveSession::arming_code() {
  const auto stop = current_stop();
  return stop && physical() ? arming_code_.shown(*stop) : std::string();
}

Result<void> LiveSession::rearm_here(std::uint32_t stop) {
  if (rearmed_in_page())
    return refused("a pointer can be rearmed only by the viewer that moves it", "",
                   "press Rearm in the page");
  return rearm(stop, {Asker::kKey});
}

Result<void> LiveSession::rearm(std::uint32_t stop, AskedBy by) {
  ServoLoop* loop = loop_.load();
  if (!loop) return not_running();
  switch (rearm_logged(*loop, told_, by, stop)) {
    case RearmResult::kNotStopped:
      return refused("the force is not stopped", "stop", "");
    case RearmResult::kStoppedAgain:
      return refused("there was another stop after the one to rearm from", "stop",
                     "check the reason, and rearm again");
    case RearmResult::kNotApplied:
      return refused("the stop has not taken effect yet", "stop", "try again in a moment");
    case RearmResult::kTouching:
      return refused("the tip touches something", "", "move it to free space, then rearm");
    case RearmResult::kDone:
      break;
  }
  return {};
}

void LiveSession::stop_unsupervised() {
  stop({Asker::kSession});
}

void LiveSession::pause_here() {
  if (ServoLoop* loop = loop_.load())
    change_logged(*loop, told_, {Asker::kKey},
                  [](Parameters& parameters) { parameters.paused = !parameters.paused; });
}

void LiveSession::next_method() {
  ServoLoop* loop = loop_.load();
  if (!loop) return;
  const std::lock_guard lock(mutex_);
  const ForceMethod now = awaited_.value_or(loop->parameters().method);
  const auto possible = [&](ForceMethod method) { return is_choosable(method) && can_be_prepared(method); };
  ForceMethod next = next_of(now);
  while (next != now && !possible(next)) next = next_of(next);
  if (auto chosen = choose(next, {Asker::kKey}, *loop); !chosen) give_up(next, chosen.error());
}

Result<void> LiveSession::motor_here() {
  ServoLoop* loop = loop_.load();
  if (!loop) return not_running();
  if (!cuts()) return bad("no device has a tool with a motor", "", "");
  change_logged(*loop, told_, {Asker::kKey},
                [](Parameters& parameters) { parameters.motor = !parameters.motor; });
  return {};
}

Result<void> LiveSession::stroke_here(StrokeAction action) {
  ServoLoop* loop = loop_.load();
  if (!loop) return not_running();
  const std::lock_guard lock(mutex_);
  const LastStrokeRequest wanted{{action, {}, 0}, loop->strokes()};
  if (auto fine = check(wanted, loop->parameters()); !fine) return fine.error();
  return apply(wanted, {Asker::kKey});
}

void LiveSession::follow_script() {
  ServoLoop* loop = loop_.load();
  if (!loop) return;
  const ForceMethod method = loop->parameters().method;
  // the mutex may be contended; the next call follows soon
  const std::unique_lock lock(mutex_, std::try_to_lock);
  if (!lock || awaited_ || is_available(method) || !parts_.model->has(method)) return;
  if (!can_be_prepared(method))
    give_up(method, made_for_others());
  else if (method_failure_ && given_up_ == model_.felt->version)
    give_up(method, *method_failure_);
  else if (auto chosen = choose(method, {Asker::kScript}, *loop); !chosen)
    give_up(method, chosen.error());
}

// ---- fields

Result<void> LiveSession::choose(ForceMethod method, AskedBy by, ServoLoop& loop) {
  awaited_.reset();
  method_failure_.reset();
  if (is_available(method)) {
    change_logged(loop, told_, by, [&](Parameters& parameters) { parameters.method = method; });
    return {};
  }
  if (auto started = start_maker(); !started) return started;
  awaited_ = method;
  awaited_by_ = by;
  wanted_.notify_one();
  return {};
}

Result<void> LiveSession::start_maker() try {
  if (!maker_.joinable()) maker_ = std::thread([this] { run_maker(); });
  return {};
} catch (const std::system_error& error) {
  return Error{ErrorKind::kUnavailable,
               std::string("cannot start the thread for model changes: ") + error.what(), "",
               "close other programs, or raise the process limit (ulimit -u)"};
}

void LiveSession::run_maker() {
  // threads started from here inherit the lowest priority
  ::setpriority(PRIO_PROCESS, static_cast<id_t>(::gettid()), kLowestPriority);
  const Progress progress({}, &ending_);
  std::shared_ptr<const Model> fields;
  std::unique_lock lock(mutex_);
  while (true) try {
      wanted_.wait(lock, [this] { return ending_ || awaited_ || law_awaited_; });
      if (ending_) return;
      if (law_awaited_) {
        prepare_law(lock, progress);
        continue;
      }
      const ModelVersions of = model_;
      const ForceMethod method = *awaited_;
      // unlock: a thread waiting for the mutex would inherit this thread's low priority as latency
      lock.unlock();
      const auto ready = fields_for(method, of, fields, progress);
      lock.lock();
      // the model changed meanwhile: another version, and possibly other fields, are needed
      const bool again = model_.felt != of.felt;
      if (!again || !awaited_) fields = nullptr;
      if (again) continue;
      auto felt = ready ? use_fields(*ready) : Result<void>(ready.error());
      if (felt) continue;
      // another method may have been requested meanwhile
      if (awaited_ == method) give_up(method, felt.error());
    } catch (const std::exception&) {
      if (!lock) lock.lock();
      if (law_awaited_) script_law_led_to_ = 0;
      try {
        const Error why{ErrorKind::kUnavailable, "out of memory", "", ""};
        if (law_awaited_) law_failure_.emplace(why).where = name_of(*law_awaited_, kTissueLaws);
        if (awaited_) method_failure_.emplace(why).where = name_of(*awaited_);
      } catch (const std::bad_alloc&) {
        // the request ends without a reason
      }
      awaited_.reset();
      law_awaited_.reset();
      given_up_ = model_.felt->version;
    }
}

// Returns a model whose fields match the current stiffnesses and that is prepared for `method`.
// @param fields  result of an earlier attempt; reused if it matches, otherwise regenerated
Result<std::shared_ptr<const Model>> LiveSession::fields_for(ForceMethod method, const ModelVersions& of,
                                                             std::shared_ptr<const Model>& fields,
                                                             const Progress& progress) const try {
  if (!fields || !fields_match(*of.felt, *fields)) {
    fields = of.made;
    if (!fields_match(*of.felt, *of.made)) {
      auto made = parts_.new_fields(*of.felt, *of.made, progress);
      if (!made) return made.error();
      fields = *std::move(made);
    }
  }
  // running out of memory would end the session, so the demand is checked first
  if (!fields->has(method))
    if (auto allowed = allow_memory(memory_of_force_field(*fields, method), std::string(name_of(method)));
        !allowed)
      return allowed.error();
  auto more = parts_.more_methods(fields, {&method, 1}, progress);
  if (more) fields = *more;
  return more;
} catch (const std::exception& why) {
  return not_made(why);
}

Result<void> LiveSession::use_fields(std::shared_ptr<const Model> fields) try {
  ServoLoop& loop = *loop_.load();
  if (fields_match(*model_.felt, *model_.made)) {
    // preparing further methods leaves the haptic properties unchanged, so no new version is needed
    auto next = std::make_shared<Model>(*model_.felt);
    next->methods = fields->methods;
    loop.set_model(next);
    model_ = {std::move(next), std::move(fields)};
  } else {
    const auto next = with_fields(*model_.felt, *fields);
    apply_version({next, next}, {next->version, ModelChange::kFieldsRebuilt}, awaited_by_, loop);
  }
  return awaited_ && is_available(*awaited_) ? choose(*awaited_, awaited_by_, loop) : Result<void>();
} catch (const std::exception& why) {
  return not_made(why);
}

// keeps the current method and reports the error to whoever requested the change
void LiveSession::give_up(ForceMethod method, Error why) {
  awaited_.reset();
  given_up_ = model_.felt->version;
  why.where = name_of(method);
  method_failure_ = std::move(why);
  // a script may have selected the method before its fields were generated: fall back to the proxy
  change_logged(*loop_.load(), told_, {}, [&](Parameters& parameters) {
    if (parameters.method == method && model_.felt->has(ForceMethod::kProxy))
      parameters.method = ForceMethod::kProxy;
  });
}

void LiveSession::end() {
  {
    const std::lock_guard lock(mutex_);
    ending_.store(true);
  }
  wanted_.notify_one();
  if (maker_.joinable()) maker_.join();
  if (cutter_.joinable()) cutter_.join();
  yields_.store(nullptr);
  tissue_.reset();
  loop_.store(nullptr);
}

Result<void> LiveSession::take_pointer(bool take, const ViewerIdentity& by) {
  if (!parts_.pointer)
    return refused("the tip is moved by the " + parts_.input + " here", "take",
                   "start palpate explore with --device pointer");
  ServoLoop* loop = loop_.load();
  if (take && !loop) return not_running();
  const bool was_taken = pointer_taken_.exchange(take);
  if (!take) parts_.pointer->release();
  if (loop && take != was_taken) log_pointer_change(*loop, told_, asked_by(by));
  return {};
}

void LiveSession::move_pointer(const std::array<double, 3>& tip_patient_mm) {
  const ServoLoop* loop = loop_.load();
  if (!pointer_taken_.load() || !loop) return;
  // pose of the object as currently rendered
  const Point<World> tip =
      turned_object(parts_.model->X_WorldPatient, quaternion(loop->snapshot().rotation_felt_wxyz)) *
      Point<Patient>(tip_patient_mm[0], tip_patient_mm[1], tip_patient_mm[2]);
  // World's origin is the volume's centre. The negated comparison also rejects NaN.
  if (!(tip.eigen().norm() <= kFarthestTip_mm)) return;
  parts_.pointer->move(WorkspaceMapping(parts_.pointer->devices().front(), parts_.workspace).to_device(tip));
}

// ---- tasks

ViewedTraining LiveSession::training() const {
  return parts_.training != nullptr ? parts_.training->state() : ViewedTraining{};
}

std::shared_ptr<const ViewedDebriefing> LiveSession::debriefing() const {
  return parts_.training != nullptr ? parts_.training->debriefing() : nullptr;
}

Result<void> LiveSession::train(const TaskRequest& request) {
  if (parts_.training == nullptr) return ViewerHost::train(request);
  // the evaluator gets ticks only while the loop runs
  if (!loop_.load()) return not_running();
  return request.begin ? parts_.training->begin(*request.begin, request.learner) : parts_.training->end_run();
}

Result<void> LiveSession::teach(const LessonRequest& request) {
  if (request.learner || request.task) {
    if (parts_.training == nullptr)
      return refused("there is no task for a lesson", "", "start palpate explore with --task");
    if (auto taught = parts_.training->teach(request); !taught) return taught;
  }
  if (request.end) is_over_ = true;
  return {};
}

Result<std::string> LiveSession::curves(const std::string& learner) const {
  return keeps_runs() ? parts_.training->curves(learner) : ViewerHost::curves(learner);
}

Result<void> LiveSession::task_here() {
  if (parts_.training == nullptr)
    return refused("there is no task to start", "", "start palpate explore with --task");
  if (!loop_.load()) return not_running();
  return parts_.training->begin_or_end();
}

// ---- a tracked tool

std::optional<ViewedNavigation> LiveSession::navigation() const {
  const ServoLoop* loop = loop_.load();
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
  return parts_.plan != nullptr ? parts_.plan->live() : nullptr;
}

Result<void> LiveSession::change(const PlanRequest& request) {
  return parts_.plan != nullptr ? parts_.plan->change(request) : ViewerHost::change(request);
}

Result<void> LiveSession::play(const PlayRequest& /*request*/) {
  return refused("this is a live session, not a recording", "", "palpate replay RECORDING --view shows one");
}

}  // namespace palpate
