#pragma once

#include <atomic>
#include <cmath>
#include <limits>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "palpate/device/model_change.h"
#include "palpate/device/sweep_record.h"
#include "palpate/server/tick_history.h"
#include "palpate/server/viewer_server.h"

/// In-memory session that carries out and records every request.
namespace palpate::testing {

inline ViewedTask test_task() {
  ViewedTask task;
  task.name = "hold";
  task.title = "Hold\x1b[31m";
  task.briefing = "Press.\nGently.";
  task.quiz = task.ordered = true;
  task.ends_with_steps = false;
  task.time_limit_s = 60;
  task.in_a_row = 3;
  task.regions = {{"front", {1, 2, 3}, 12.5, {0, -1, 0}}};
  task.steps = {{"push", "touch", 0, {0.8, std::numeric_limits<double>::infinity()}, 3, 0.5, true}};
  task.forces = {{{1, 2}, std::array{0.8, 1.2}, {}}};
  task.protections = {{{2}, 0.2}};
  task.metrics = {{"peak_force", "N", {1}, false, {}, 8.5, "Tuijthof"}, {"time", "s", {}, false, {}, {}, ""}};
  task.to_find = {2};
  task.scope = {30, 8};
  return task;
}
inline ViewedTraining test_training() {
  ViewedTraining training;
  training.phase = ViewedTraining::Phase::kRunning;
  training.run = 3;
  training.task = "hold";
  training.time_s = 1.23456;
  training.done = {false};
  training.fraction = {1.0 / 3};
  training.forces_N = {1.1};
  training.protected_N = {0};
  training.touch_N = 1.5;
  training.unseen = true;
  training.events = {{"over_limit", 0, 1.0, 2.6}};
  training.events_before = 4;
  training.is_stored = true;
  return training;
}
inline ViewedDebriefing test_debriefing() {
  ViewedDebriefing debriefing;
  debriefing.run = 3;
  debriefing.task = "hold";
  debriefing.end = "asked";
  debriefing.metrics = {{0.1 + 0.2, 0.25, true}, {}};
  debriefing.done = {true};
  debriefing.events = {{"step_done", 0, 1.5, 1.0}};
  debriefing.forces = 1;
  debriefing.samples = {{0.02, {1, 2, 3.45678}, 1.5, {1.1}}, {0.04, {kNoValue, kNoValue, kNoValue}, 0, {}}};
  debriefing.patches = {{{0.5, 1.5, 2.5}, true}, {{0.5, 1.5, 3.5}, false}};
  debriefing.answer_mm = std::array{1.0, 2.0, 3.0};
  debriefing.runs = 4;
  debriefing.run_id = 17;
  return debriefing;
}

class FakeHost : public LiveHost {
 public:
  explicit FakeHost(std::array<int, 3> dims = {5, 4, 3}) {
    GridGeometry grid;
    grid.dims = dims;
    grid.spacing_mm = {0.5, 0.75, 2};
    grid.origin = Point<Patient>(-60, -64, -31);
    auto scan = std::make_shared<Volume<float>>(grid);
    Volume<LabelId> labels(grid);
    for (std::size_t v = 0; v < grid.voxel_count(); ++v) {
      scan->voxels()[v] = static_cast<float>(static_cast<int>(v % 4000) - 1000);
      labels.voxels()[v] = static_cast<LabelId>(v / 7 % 3);
    }
    scene_.scan = scan;
    scene_.labels = label_bricks(labels);
    scene_.side = "left";
    scene_.modality = "ct";
    scene_.content_hash = 0x0f3a000000000001;
    scene_.window = {12, 480};
    scene_.world_from_patient = {{{1, 0, 0, 0}, {0, 0, 1, 0}, {0, -1, 0, 0}, {0, 0, 0, 1}}};
    scene_.structures = {{1, "femur", {240, 220, 190}, 0}, {2, "tibia", {10, 20, 30}, -1, {1}}};
    scene_.tissues = {{"bone", true, {240, 220, 190}, 1, {}}, {"skin", false, {1, 2, 3}, 0.25, {0}}};
    scene_.tools = {{"point", 0, false, "cone", {{0, 0, 0}}, {{{0, 0, 0}, {0, 0, 40}, 1.5, 2}}},
                    {"drill", 2, true, "ball", {{0, 0, 0}}, {}, true}};
    scene_.methods = {"proxy", "trilinear"};
    scene_.laws = {"elastic", "neo-hookean"};
    scene_.device_name = "simulated";
    state_.method = ForceMethod::kProxy;
    state_.law = "elastic";
    state_.max_force_N = 1.4;
    state_.tissues = {{1.5, 0.2, 0.15, 0.001}, {0.3, 0, 0, 0}};
  }

  const ViewedScene& scene() const override { return scene_; }
  TickRecord snapshot(std::array<double, kMaxDevices>& stiffness_N_per_mm) const override {
    ++snapshots;
    TickRecord tick;
    tick.tick = static_cast<std::uint64_t>(snapshots);
    tick.model_version = 3;
    {
      const std::lock_guard lock(mutex_);
      tick.device[0] = near_;
    }
    tick.device[0].tip_patient_mm = {1, 2, 3};
    stiffness_N_per_mm[0] = 0.75;
    return tick;
  }
  const TickHistory* tick_history() const override { return &history; }
  ViewedHealth health() const override { return {999, 1, 2, 3, 4, 5, 6, 7}; }
  ViewedState state() const override {
    const std::lock_guard lock(mutex_);
    return state_;
  }
  std::vector<SweepRecord> sweeps(std::uint32_t /*version*/, std::uint64_t first,
                                  std::size_t largest) const override {
    const std::lock_guard lock(mutex_);
    std::vector<SweepRecord> next;
    for (std::uint64_t n = first; n < state_.sweeps && next.size() < largest; ++n)
      next.push_back({0, {static_cast<double>(n), 0, 0}, {0, 1, 0}, 2});
    return next;
  }
  std::shared_ptr<const ViewedDeformation> deformation(std::size_t device) const override {
    const std::lock_guard lock(mutex_);
    ++deformation_requested;
    return deformations_.at(device);
  }
  void set_deformation(std::size_t device, std::shared_ptr<const ViewedDeformation> value) {
    const std::lock_guard lock(mutex_);
    deformations_.at(device) = std::move(value);
  }
  std::optional<ViewedNavigation> navigation() const override {
    const std::lock_guard lock(mutex_);
    return navigation_;
  }
  void navigate(const ViewedNavigation& navigation) {
    const std::lock_guard lock(mutex_);
    navigation_ = navigation;
  }
  /// Sets what ticks report of distances and no-go regions.
  void bring_near(const DeviceTick& near) {
    const std::lock_guard lock(mutex_);
    near_ = near;
  }
  /// Removes the last `count` sweeps.
  void uncut(std::uint64_t count) {
    const std::lock_guard lock(mutex_);
    state_.sweeps -= count;
    ++state_.model_version;
  }
  /// Removes the last `undone` sweeps and adds `count` others in one step.
  void cut_anew(std::uint64_t undone, std::uint64_t count) {
    const std::lock_guard lock(mutex_);
    state_.sweeps -= undone;
    state_.undone_to.push_back(state_.sweeps);
    state_.sweeps += count;
    ++state_.model_version;
  }
  /// Adds `count` sweeps, each of which begins at an x equal to its index.
  void cut(std::uint64_t count) {
    const std::lock_guard lock(mutex_);
    state_.sweeps += count;
    ++state_.model_version;
  }
  Result<RequestOutcome> set(const SettingsRequest& request) override {
    const std::lock_guard lock(mutex_);
    requested_by_ = request.by;
    if (asks_) {
      requested_.push_back({request.by, request.id, {}});
      return RequestOutcome::kAwaitingConsent;
    }
    if (request.max_force_N && *request.max_force_N > 3)
      return Error{ErrorKind::kUsage, "is above what this device may give", "max_force_N", "ask for less"};
    if (request.method) state_.method = find_force_method(*request.method).value_or(state_.method);
    apply_changes(request, state_);
    return RequestOutcome::kDone;
  }
  Result<RequestOutcome> set(const StrokeRequest& request) override {
    const std::lock_guard lock(mutex_);
    requested_by_ = request.by;
    const bool undo = request.action == StrokeAction::kUndo;
    std::size_t &from = undo ? state_.strokes_to_undo : state_.strokes_to_redo,
                &to = undo ? state_.strokes_to_redo : state_.strokes_to_undo;
    if (from == 0) return Error{ErrorKind::kUsage, "there is no such stroke", "", ""};
    --from;
    ++to;
    return RequestOutcome::kDone;
  }
  Result<RequestOutcome> set(const TissueRequest& request) override {
    const std::lock_guard lock(mutex_);
    requested_by_ = request.by;
    if (static_cast<std::size_t>(request.tissue) >= state_.tissues.size())
      return Error{ErrorKind::kUsage, "is no tissue", "tissue", ""};
    ContactProperties& tissue = state_.tissues[request.tissue];
    tissue = request.changes.applied_to(tissue);
    ++state_.model_version;
    return RequestOutcome::kDone;
  }
  std::vector<LateAnswer> read_answers() override {
    const std::lock_guard lock(mutex_);
    return std::exchange(answers_, {});
  }
  void forget(const ViewerIdentity& viewer) override {
    const std::lock_guard lock(mutex_);
    std::erase_if(requested_, [&](const LateAnswer& request) { return request.by.number == viewer.number; });
  }
  void emergency_stop(const ViewerIdentity& by) override {
    const std::lock_guard lock(mutex_);
    requested_by_ = by;
    state_.stop = ++stops_;
    state_.stopped_by = StoppedBy::kViewer;
    state_.stopped_by_viewer = by.number;
  }
  Result<void> rearm(const RearmRequest& request) override {
    const std::lock_guard lock(mutex_);
    requested_by_ = request.by;
    if (state_.armed) return Error{ErrorKind::kUsage, "arming is local", "", "arm at the device"};
    if (state_.stop != request.stop) return Error{ErrorKind::kUsage, "is another stop", "stop", "look again"};
    state_.stop.reset();
    return {};
  }
  Result<void> claim_pointer(bool take, const ViewerIdentity& by) override {
    const std::lock_guard lock(mutex_);
    requested_by_ = by;
    pointer_claimed = take;
    return {};
  }
  void move_pointer(const std::optional<PointerTarget>& target) override {
    const std::lock_guard lock(mutex_);
    pointer_ = target;
  }

  ViewedTraining training() const override {
    const std::lock_guard lock(mutex_);
    return training_;
  }
  std::shared_ptr<const ViewedDebriefing> debriefing() const override {
    const std::lock_guard lock(mutex_);
    return debriefing_;
  }
  Result<void> train(const TaskRequest& request) override {
    const std::lock_guard lock(mutex_);
    if (request.begin && *request.begin != "hold") return Error{ErrorKind::kUsage, "is no task", "begin", ""};
    const std::string own = request.learner.empty() ? state_.lesson.learner : request.learner;
    const std::string learner = request.begin ? own : training_.learner;
    training_ = test_training();
    training_.learner = learner;
    training_.phase = request.begin ? ViewedTraining::Phase::kRunning : ViewedTraining::Phase::kOver;
    ViewedDebriefing over = test_debriefing();
    over.learner = training_.learner;
    debriefing_ = request.begin ? nullptr : std::make_shared<const ViewedDebriefing>(over);
    return {};
  }
  Result<void> teach(const LessonRequest& request) override {
    const std::lock_guard lock(mutex_);
    state_.lesson.learner = request.learner.value_or(state_.lesson.learner);
    state_.lesson.task = request.task.value_or(state_.lesson.task);
    state_.lesson.is_over = state_.lesson.is_over || request.end;
    return {};
  }
  bool stores_runs() const override { return stores_runs_; }
  Result<std::string> curves(const std::string& learner) const override {
    return "<p>" + (learner.empty() ? "everybody" : learner) + "</p>";
  }
  /// Call before the server starts.
  void store_runs() { stores_runs_ = true; }
  bool ended() const {
    const std::lock_guard lock(mutex_);
    return state_.lesson.is_over;
  }
  /// Advances the run.
  void train_on(double time_s) {
    const std::lock_guard lock(mutex_);
    training_.time_s = time_s;
  }

  std::shared_ptr<const ViewedPlan> plan() const override {
    const std::lock_guard lock(mutex_);
    return plan_;
  }
  Result<void> change(const PlanRequest& request) override {
    const std::lock_guard lock(mutex_);
    if (!plan_ || request.version != plan_->version)
      return Error{ErrorKind::kUsage, "is another plan", "version", "look again"};
    auto next = std::make_shared<ViewedPlan>(*plan_);
    ++next->version;
    if (request.name) next->trajectories.at(request.trajectory.value()).name = *request.name;
    next->saved = request.save;
    plan_ = std::move(next);
    return {};
  }
  void rehearse(ViewedPlan plan) {
    const std::lock_guard lock(mutex_);
    plan_ = std::make_shared<const ViewedPlan>(std::move(plan));
  }

  std::optional<PointerTarget> pointer() const {
    const std::lock_guard lock(mutex_);
    return pointer_;
  }
  /// Settings need consent from now on.
  void ask_first() {
    const std::lock_guard lock(mutex_);
    asks_ = true;
  }
  /// Number of pending questions.
  std::size_t requested() const {
    const std::lock_guard lock(mutex_);
    return requested_.size();
  }
  /// Answers all pending questions with the same outcome.
  void answer(const Result<void>& outcome) {
    const std::lock_guard lock(mutex_);
    for (const LateAnswer& request : requested_) answers_.push_back({request.by, request.id, outcome});
    requested_.clear();
  }
  /// Originator of the last request.
  ViewerIdentity requested_by() const {
    const std::lock_guard lock(mutex_);
    return requested_by_;
  }
  /// Changes the state as another user would, for example at the terminal.
  template <class Change>
  void change(Change&& change) {
    const std::lock_guard lock(mutex_);
    change(state_);
  }
  /// Call before the server starts.
  ViewedScene& edit_scene() { return scene_; }
  std::shared_ptr<const Bricks<LabelId>> labels() const override {
    const std::lock_guard lock(mutex_);
    return cut_labels_ ? cut_labels_ : scene().labels;
  }
  /// Replaces the scene's labels by those after a cut.
  void cut(std::shared_ptr<const Bricks<LabelId>> labels) {
    const std::lock_guard lock(mutex_);
    cut_labels_ = std::move(labels);
  }

  mutable std::atomic<int> snapshots{0}, deformation_requested{0};
  std::atomic<bool> pointer_claimed{false};
  TickHistory history;

 private:
  ViewedScene scene_;
  mutable std::mutex mutex_;
  ViewedState state_;
  std::shared_ptr<const Bricks<LabelId>> cut_labels_;  // null: nothing is cut
  std::array<std::shared_ptr<const ViewedDeformation>, kMaxDevices> deformations_;
  DeviceTick near_;
  std::optional<ViewedNavigation> navigation_;
  std::shared_ptr<const ViewedPlan> plan_;
  ViewedTraining training_;
  std::shared_ptr<const ViewedDebriefing> debriefing_;
  std::optional<PointerTarget> pointer_;
  ViewerIdentity requested_by_;
  std::uint32_t stops_ = 0;
  bool asks_ = false, stores_runs_ = false;
  std::vector<LateAnswer> requested_, answers_;
};

/// In-memory recording that stays where it is led.
class FakeRecording : public PlaybackHost {
 public:
  FakeRecording() {
    GridGeometry grid;
    grid.dims = {2, 2, 2};
    scene_.labels = label_bricks(Volume<LabelId>(grid));
    scene_.input = "recording";
    state_.playback = ViewedState::Playback{};
  }
  const ViewedScene& scene() const override { return scene_; }
  TickRecord snapshot(std::array<double, kMaxDevices>& /*stiffness_N_per_mm*/) const override { return {}; }
  ViewedHealth health() const override { return {}; }
  ViewedState state() const override {
    const std::lock_guard lock(mutex_);
    return state_;
  }
  void emergency_stop(const ViewerIdentity& /*by*/) override {
    const std::lock_guard lock(mutex_);
    state_.playback->playing = false;
  }
  Result<void> play(const PlayRequest& request) override {
    const std::lock_guard lock(mutex_);
    if (request.at_s) played_at_s_ = *request.at_s;
    if (request.playing) state_.playback->playing = *request.playing;
    if (request.speed) state_.playback->speed = *request.speed;
    return {};
  }
  double played_at_s() const {
    const std::lock_guard lock(mutex_);
    return played_at_s_;
  }

 private:
  ViewedScene scene_;
  mutable std::mutex mutex_;
  ViewedState state_;
  double played_at_s_ = 0;
};

/// Log lines of a server.
class TestLog {
 public:
  std::function<void(const std::string&)> writer() {
    return [this](const std::string& line) {
      const std::lock_guard lock(mutex_);
      text_ += line + "\n";
    };
  }
  std::string text() const {
    const std::lock_guard lock(mutex_);
    return text_;
  }

 private:
  mutable std::mutex mutex_;
  std::string text_;
};

/// Server with a FakeHost on a free port.
struct TestServer {
  /// @param input  ViewedScene::input
  explicit TestServer(ViewerServerOptions options = {}, std::array<int, 3> dims = {5, 4, 3},
                      const std::string& input = "script", std::vector<ViewedTask> tasks = {},
                      std::vector<ViewedNoGo> no_go = {}, bool stores_runs = false)
      : host(dims) {
    if (stores_runs) host.store_runs();
    host.edit_scene().input = input;
    host.edit_scene().tasks = std::move(tasks);
    host.edit_scene().no_go = std::move(no_go);
    options.port = 0;
    options.log = log.writer();
    auto started = ViewerServer::start(host, options);
    PALPATE_CHECK(started.ok());
    server = *std::move(started);
  }
  int port() const { return server->port(); }
  std::string host_name() const { return "127.0.0.1:" + std::to_string(port()); }

  TestLog log;
  FakeHost host;
  std::unique_ptr<ViewerServer> server;
};

}  // namespace palpate::testing
