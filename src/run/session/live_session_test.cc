#include "session/live_session.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <list>
#include <new>
#include <optional>
#include <stdexcept>
#include <thread>

#include "base/test_files.h"
#include "base/test_wait.h"
#include "loading/test_loading.h"
#include "palpate/base/clock.h"
#include "palpate/base/mailbox.h"
#include "palpate/base/reading.h"
#include "palpate/base/spsc_ring.h"
#include "palpate/direct/direct_methods.h"
#include "palpate/model/make_model.h"
#include "palpate/palpation/palpation.h"
#include "palpate/session/explore.h"

namespace palpate {
namespace {

using ::testing::HasSubstr;
using testing::soon;

constexpr double kCartilage_mm = 3;
constexpr int kViewedBone = 0, kViewedCartilage = 1;

double sent_N(const TickRecord& tick) {
  const auto& f = tick.device[0].force_N;
  return Eigen::Vector3d(f[0], f[1], f[2]).norm();
}

// device whose tip follows the test's command regardless of any force
class HeldDriver final : public DeviceDriver {
 public:
  explicit HeldDriver(bool simulated) {
    info_.name = "held";
    info_.simulated = simulated;
    info_.peak_force_N = 8;
  }
  void hold(const Point<Device>& tip) { tips_.post(tip); }
  std::span<const DeviceInfo> devices() const override { return {&info_, 1}; }
  Result<void> open(bool) override { return {}; }
  void run(ServoFunction& servo, ServoClock& clock) noexcept override {
    std::array<DeviceSample, 1> samples;
    std::array<DeviceCommand, 1> commands{};
    samples[0].tip = Point<Device>(0, 0, 40);
    while (clock.wait()) {
      // limited to the speed of a hand
      tips_.take(to_);
      const Vector<Device> displacement = to_ - samples[0].tip;
      samples[0].tip += displacement * std::min(1.0, 0.5 / std::max(displacement.norm(), 1e-9));
      samples[0].taken_ns = monotonic_ns();
      servo.update(samples, commands);
    }
  }
  void halt() noexcept override {}
  void resume(std::uint64_t /*newest*/) noexcept override {}

 private:
  DeviceInfo info_;
  Mailbox<Point<Device>> tips_;
  Point<Device> to_{0, 0, 40};
};

// the ball with its shell in a running loop, with a session
class Viewed : public ::testing::Test {
 protected:
  void start(bool simulated = true, const WorkspaceSettings& workspace = {},
             double max_stiffness = std::numeric_limits<double>::infinity(), bool ramps = false) {
    Model ball = testing::ball_model({1, 1, 1}, 1.0, kCartilage_mm);
    if (ramps) ball = testing::with_ramps(std::move(ball), 6, kCartilage_mm);
    if (every_method_) ball = testing::with_every_method(std::move(ball));
    Model model = testing::with_exact_surfaces(std::move(ball), kCartilage_mm);
    model.title = "DOE^CANARY";
    model.side = Side::kLeft;
    model.scene_max_force_N = 5;
    model.tools = tools_;
    model.tissues[kViewedCartilage].elastic = shell_;
    if (proxy_alone_) {
      model.field = nullptr;
      model.methods = {};
    }
    model_ = std::make_shared<const Model>(std::move(model));
    workspace_ = workspace;
    driver_.emplace(simulated);
    Parameters parameters;
    parameters.method = ForceMethod::kProxy;
    parameters.passivity = false;
    parameters.max_force_N = 3;
    parameters.device[0] = device_parameters(driver_->devices()[0], workspace);
    parameters.device[0].max_stiffness_N_per_mm = max_stiffness;
    const auto devices = driver_->devices();
    live_.emplace(LiveSessionParts{model_,
                                   {devices.begin(), devices.end()},
                                   workspace,
                                   parameters,
                                   "device",
                                   1000,
                                   nullptr,
                                   false,
                                   Modality::kMr,
                                   asks_here_,
                                   nullptr,
                                   rebuild_fields_,
                                   prepare_methods_,
                                   prepare_law_,
                                   solve_tissue_});
    auto loop =
        ServoLoop::start(model_, *driver_, parameters, {workspace}, {.realtime = false, .ring_s = 30});
    PALPATE_CHECK(loop.ok());
    loop_ = *std::move(loop);
    watch_.emplace(*model_, std::vector<HoldRequest>{});
    live_->begin(*loop_, *watch_);
  }
  void TearDown() override {
    if (live_) live_->end();
    if (loop_) loop_->stop();
  }

  // presses the tip to `depth_mm` in the shell, from above; waits until the force is on
  void press(double depth_mm) {
    const Point<World> above(0, 0, 40), tip(0, 0, testing::kBoneRadius_mm + kCartilage_mm - depth_mm);
    const WorkspaceMapping mapping(driver_->devices()[0], workspace_);
    driver_->hold(mapping.to_device(above));
    ASSERT_TRUE(soon([&] { return at(above) && (latest().device[0].flags & kFlagRamp) == 0; }));
    driver_->hold(mapping.to_device(tip));
    ASSERT_TRUE(soon([&] { return at(tip) && (latest().device[0].flags & kFlagContact) != 0; }));
    ASSERT_TRUE(is_steady());
  }
  /// Waits until viscous and transient forces have decayed: the same force 0.1 s of servo time later.
  bool is_steady() {
    TickRecord before = latest();
    return soon([&] {
      const TickRecord now = latest();
      if (now.time_s < before.time_s + 0.1) return false;
      const bool unchanged = std::abs(sent_N(now) - sent_N(before)) < 1e-6;
      before = now;
      return unchanged;
    });
  }
  bool at(const Point<World>& tip) const {
    const auto now = latest().device[0].tip_world_mm;
    return (Point<World>(now[0], now[1], now[2]) - tip).norm() < 1e-6;
  }
  TickRecord latest() const { return loop_->snapshot(); }
  double stiffness() const {
    std::array<double, kMaxDevices> stiffness_N_per_mm{};
    (void)live_->snapshot(stiffness_N_per_mm);
    return stiffness_N_per_mm[0];
  }
  Error error_of(const SettingsRequest& request) { return error_in(live_->set(request)); }
  Error error_of(const TissueRequest& request) { return error_in(live_->set(request)); }
  template <class T>
  static Error error_in(const Result<T>& result) {
    return result.ok() ? Error{ErrorKind::kBadInput, "no error", "", ""} : result.error();
  }
  // drains the ring
  std::vector<TickRecord> ticks() {
    std::vector<TickRecord> all(loop_->ring().size());
    all.resize(loop_->ring().pop(std::span(all)));
    return all;
  }

  // all events logged for the recorder so far
  const std::list<RecordingEvent>& reported() {
    live_->log().take(reported_);
    return reported_;
  }
  std::vector<ModelChange> changes() {
    std::vector<ModelChange> changes;
    for (const RecordingEvent& event : reported())
      if (event.kind == RecordingEvent::Kind::kModel) changes.push_back(event.change);
    return changes;
  }

  // moves the tip out of contact, where a rearm is possible
  void leave() {
    const Point<World> above(0, 0, 40);
    driver_->hold(WorkspaceMapping(driver_->devices()[0], workspace_).to_device(above));
    ASSERT_TRUE(soon([&] { return at(above); }));
  }
  // number of the current stop, once a tick has applied it
  std::uint32_t stopped() {
    const std::uint32_t stop = live_->state().stop.value_or(0);
    EXPECT_GT(stop, 0u);
    EXPECT_TRUE(soon([&] { return latest().arming_number >= stop; }));
    EXPECT_TRUE(latest().switches & kSwitchEmergencyStop);
    return stop;
  }
  // answers the pending question by a key; returns what its viewer receives
  LateAnswer answer(bool agreed) {
    live_->answer_by_key(live_->question().value_or(ConsentQuestion{}).number, agreed);
    const auto answers = live_->read_answers();
    EXPECT_EQ(answers.size(), 1u);
    return answers.empty() ? LateAnswer{{}, 0, not_answered()} : answers.front();
  }
  static Error not_answered() { return {ErrorKind::kUsage, "no answer", "", ""}; }

  bool asks_here_ = true;
  std::list<RecordingEvent> reported_;
  bool every_method_ = true;  // false: the trilinear method and the proxy only
  bool proxy_alone_ = false;  // true: no direct method and no field
  decltype(LiveSessionParts::rebuild_fields) rebuild_fields_ = with_rebuilt_fields;
  decltype(LiveSessionParts::prepare_methods) prepare_methods_ = with_methods;
  decltype(LiveSessionParts::prepare_law) prepare_law_ = measured_under_law;
  decltype(LiveSessionParts::solve_tissue) solve_tissue_ = begin_tissue_frame;
  std::optional<ElasticConstants> shell_;  // constants of the shell's elastic laws
  std::vector<Tool> tools_{Tool()};
  std::shared_ptr<const Model> model_;
  WorkspaceSettings workspace_;
  std::optional<HeldDriver> driver_;
  std::optional<LiveSession> live_;
  std::unique_ptr<ServoLoop> loop_;
  std::optional<SessionStatistics> watch_;
};

TEST_F(Viewed, PublishedSceneContainsNoPatientName) {
  start();
  const ViewedScene& scene = live_->scene();
  EXPECT_EQ(scene.side, "left");
  EXPECT_EQ(scene.modality, "mr") << "as the scene says";
  EXPECT_EQ(scene.labels, model_->labels);
  EXPECT_EQ(scene.scan, nullptr);
  ASSERT_EQ(scene.structures.size(), 3u);
  EXPECT_EQ(scene.structures[1].name, "shell");
  EXPECT_EQ(scene.structures[1].tissue, kViewedCartilage);
  ASSERT_EQ(scene.tissues.size(), 3u);
  EXPECT_EQ(scene.tissues[1].name, "cartilage");
  EXPECT_EQ(scene.tissues[1].rests_on, std::vector<int>{kViewedBone});
  EXPECT_FALSE(scene.tissues[2].touchable);
  EXPECT_EQ(scene.methods.size(), kForceMethods.size());
  EXPECT_EQ(scene.peak_force_N, 8);
  EXPECT_EQ(scene.max_force_range.min, 0.1);
  EXPECT_EQ(scene.max_force_range.max, 5) << "the scene's";
  // patient (1, 2, 3): the display's right is the patient's left, forward is superior, up is anterior
  const auto& X = scene.world_from_patient;
  EXPECT_EQ(X[0], (std::array{1.0, 0.0, 0.0, X[0][3]}));
  EXPECT_EQ(X[1], (std::array{0.0, 0.0, 1.0, X[1][3]}));
  EXPECT_EQ(X[2], (std::array{0.0, -1.0, 0.0, X[2][3]}));

  std::string words = scene.side + scene.modality + scene.tools[0].name + scene.device_name + scene.input;
  for (const auto& structure : scene.structures) words += structure.name;
  for (const auto& tissue : scene.tissues) words += tissue.name;
  EXPECT_THAT(words, ::testing::Not(HasSubstr("CANARY")));
}

TEST_F(Viewed, ABurrThatNoDeviceHoldsHasNoMotor) {
  tools_.emplace_back().burr = BurrSettings{};
  start();
  ASSERT_EQ(live_->scene().tools.size(), 1u) << "there is one device";
  EXPECT_FALSE(live_->scene().tools[0].cuts);
  SettingsRequest motor;
  motor.motor = true;
  const auto granted = live_->set(motor);
  ASSERT_FALSE(granted.ok());
  EXPECT_EQ(granted.error().where, "motor");
}

TEST_F(Viewed, OtherVoxelsAreAnotherHashAndAirIsCt) {
  const auto scene_of = [](float value) {
    Model model = testing::ball_model({2, 2, 2});
    auto scan = std::make_shared<Volume<float>>(model.labels->geometry());
    scan->voxels()[7] = value;
    model.scan = scan;
    DeviceInfo info;
    info.simulated = true;
    return LiveSession(
               LiveSessionParts{std::make_shared<const Model>(std::move(model)), {info}, {}, {}, "script"})
        .scene();
  };
  const ViewedScene air = scene_of(-1000), same = scene_of(-1000), water = scene_of(5);
  EXPECT_EQ(air.modality, "ct");
  EXPECT_EQ(water.modality, "unknown");
  EXPECT_EQ(air.content_hash, same.content_hash);
  EXPECT_NE(air.content_hash, water.content_hash);
}

TEST_F(Viewed, SettingsAreTakenAllOrNone) {
  start();
  const double half = std::sqrt(0.5);
  SettingsRequest request;
  request.method = "trilinear";
  request.friction = false;
  request.viscosity = false;
  request.passivity = true;
  request.paused = true;
  request.max_force_N = 1.5;
  request.rotation_wxyz = {1.2 * half, 0, 0, 1.2 * half};
  for (const auto& [where, spoil] :
       std::initializer_list<std::pair<std::string, std::function<void(SettingsRequest&)>>>{
           {"method", [](auto& r) { r.method = "telepathy"; }},
           {"max_force_N", [](auto& r) { r.max_force_N = 0.05; }},
           {"max_force_N", [](auto& r) { r.max_force_N = 5.01; }},
           {"max_force_N", [](auto& r) { r.max_force_N = std::nan(""); }},
           {"max_force_N", [](auto& r) { r.max_force_N = INFINITY; }},
           {"rotation_wxyz", [](auto& r) { r.rotation_wxyz = {0, 0, 0, 0}; }},
           {"rotation_wxyz", [](auto& r) { r.rotation_wxyz = {0, 0, 3, 0}; }},
           {"rotation_wxyz", [](auto& r) {
              r.rotation_wxyz = {1, 0, 0, std::nan("")};
            }}}) {
    SettingsRequest bad = request;
    spoil(bad);
    const Error error = error_of(bad);
    EXPECT_EQ(error.where, where) << error.what;
    EXPECT_FALSE(error.remedy.empty());
    const ViewedState state = live_->state();
    EXPECT_EQ(state.method, ForceMethod::kProxy);
    EXPECT_TRUE(state.friction && state.viscosity && !state.passivity && !state.paused);
    EXPECT_EQ(state.max_force_N, 3);
    EXPECT_EQ(state.rotation_target.w(), 1);
  }

  EXPECT_EQ(error_of(request).what, "no error");
  const ViewedState state = live_->state();
  EXPECT_EQ(state.method, ForceMethod::kTrilinear);
  EXPECT_TRUE(!state.friction && !state.viscosity && state.passivity && state.paused);
  EXPECT_EQ(state.max_force_N, 1.5);
  EXPECT_NEAR(state.rotation_target.w(), half, 1e-15);
  EXPECT_NEAR(state.rotation_target.z(), half, 1e-15);
  // and the loop applies it
  ASSERT_TRUE(soon([&] { return latest().max_force_N == 1.5; }));
  EXPECT_EQ(latest().method, index_of(ForceMethod::kTrilinear));
  EXPECT_TRUE(soon([&] { return std::abs(latest().rotation_applied_wxyz[3] - half) < 1e-9; }));
}

TEST_F(Viewed, TissuesAreTakenAllOrNone) {
  start();
  TissueRequest request;
  request.tissue = kViewedCartilage;
  request.changes[&ContactProperties::stiffness_N_per_mm] = 0.5;
  request.changes[&ContactProperties::static_friction] = 0.4;
  request.changes[&ContactProperties::friction] = 0.3;
  request.changes[&ContactProperties::viscosity_N_s_per_mm] = 0;
  for (const auto& [where, spoil] :
       std::initializer_list<std::pair<std::string, std::function<void(TissueRequest&)>>>{
           {"tissue", [](auto& r) { r.tissue = -1; }},
           {"tissue", [](auto& r) { r.tissue = 3; }},
           {"stiffness_N_per_mm", [](auto& r) { r.changes[&ContactProperties::stiffness_N_per_mm] = 20.01; }},
           {"stiffness_N_per_mm", [](auto& r) { r.changes[&ContactProperties::stiffness_N_per_mm] = 1.6; }},
           {"static_friction", [](auto& r) { r.changes[&ContactProperties::static_friction] = 0.2; }},
           {"friction", [](auto& r) { r.changes[&ContactProperties::friction] = -0.1; }},
           {"viscosity_N_s_per_mm",
            [](auto& r) { r.changes[&ContactProperties::viscosity_N_s_per_mm] = 0.2; }}}) {
    TissueRequest bad = request;
    spoil(bad);
    EXPECT_EQ(error_of(bad).where, where) << error_of(bad).what;
    EXPECT_EQ(live_->state().model_version, 1u);
    EXPECT_EQ(live_->state().tissues[1].stiffness_N_per_mm, 0.75);
    EXPECT_TRUE(changes().empty());
  }
  EXPECT_EQ(error_of(request).what, "no error");
  EXPECT_EQ(live_->state().model_version, 2u);
  const ContactProperties cartilage = live_->state().tissues[1];
  EXPECT_EQ(cartilage.stiffness_N_per_mm, 0.5);
  EXPECT_EQ(cartilage.static_friction, 0.4);
  EXPECT_EQ(cartilage.friction, 0.3);
  EXPECT_EQ(cartilage.viscosity_N_s_per_mm, 0);
  EXPECT_EQ(changes(), (std::vector<ModelChange>{{2, 1, {0.5, 0.4, 0.3, 0}}}));
  // a change to the current value creates no version
  EXPECT_EQ(error_of(request).what, "no error");
  EXPECT_EQ(live_->state().model_version, 2u);
  EXPECT_TRUE(soon([&] { return latest().model_version == 2; }));
}

TEST_F(Viewed, StiffnessChangeCausesNoForceStep) {
  start();
  ASSERT_NO_FATAL_FAILURE(press(2));
  ASSERT_TRUE(soon([&] { return std::abs(sent_N(latest()) - 1.5) < 0.02; })) << sent_N(latest());
  EXPECT_EQ(stiffness(), 0.75);
  (void)ticks();
  TissueRequest request;
  request.tissue = kViewedCartilage;
  // back and forth, each before the last change has been blended in
  for (const double requested : {0.4, 0.7, 0.1, 0.75, 0.3}) {
    request.changes[&ContactProperties::stiffness_N_per_mm] = requested;
    ASSERT_EQ(error_of(request).what, "no error");
    EXPECT_EQ(stiffness(), requested);
    std::this_thread::sleep_for(std::chrono::milliseconds(40));
  }
  // the force passes 0.6 N on its way to other values, too
  ASSERT_TRUE(soon([&] {
    const TickRecord tick = latest();
    return tick.model_version == 6 && std::abs(sent_N(tick) - 0.6) < 0.02;
  })) << sent_N(latest());
  const auto recorded_ticks = ticks();
  for (std::size_t t = 1; t < recorded_ticks.size(); ++t) {
    // a step of at most 1.3 N is blended in like a seam; a delayed thread renders none
    const double max_N = 1.3 * recorded_ticks[t].dt_s *
                             (1 / kContactSettings.stiffness_filter_s + 1.5 / kOutputSettings.blend_s) +
                         0.005;
    const std::uint32_t flags = recorded_ticks[t].device[0].flags | recorded_ticks[t - 1].device[0].flags;
    if ((flags & (kFaultFlags | kFlagStale | kFlagRamp | kFlagSlew)) != 0) continue;
    EXPECT_LE(std::abs(sent_N(recorded_ticks[t]) - sent_N(recorded_ticks[t - 1])), max_N)
        << recorded_ticks[t].tick;
  }
  EXPECT_EQ(recorded_ticks.back().model_version, 6u);
  EXPECT_TRUE(soon([&] { return loop_->collect() == 1; })) << "older versions are freed";
}

TEST_F(Viewed, ReportedStiffnessIsTheRenderedStiffness) {
  for (const double largest : {std::numeric_limits<double>::infinity(), 0.2}) {
    WorkspaceSettings workspace;
    workspace.scale = 2;
    workspace.force_gain = 0.25;
    start(true, workspace, largest);
    ASSERT_NO_FATAL_FAILURE(press(2));
    EXPECT_NEAR(stiffness(), std::min(0.5 * 0.75, largest), 1e-12);
    // a millimetre of the device is two of the patient
    ASSERT_TRUE(soon([&] { return std::abs(sent_N(latest()) - stiffness() * 1) < 0.02; }))
        << sent_N(latest()) << " " << stiffness();
    TearDown();
  }
}

TEST_F(Viewed, DirectMethodRequiresAFieldOfTheSameStiffness) {
  start();
  TissueRequest softer;
  softer.tissue = kViewedCartilage;
  softer.changes[&ContactProperties::stiffness_N_per_mm] = 0.5;
  SettingsRequest direct;
  direct.method = "b-spline";
  EXPECT_EQ(error_of(softer).what, "no error");
  EXPECT_EQ(error_of(direct).where, "method");
  EXPECT_EQ(live_->state().method, ForceMethod::kProxy);
  live_->next_method();
  EXPECT_EQ(live_->state().method, ForceMethod::kProxy) << "no other suits";

  softer.changes[&ContactProperties::stiffness_N_per_mm] = 0.75;
  EXPECT_EQ(error_of(softer).what, "no error");
  EXPECT_EQ(error_of(direct).what, "no error");
  softer.changes[&ContactProperties::stiffness_N_per_mm] = 0.5;
  EXPECT_EQ(error_of(softer).where, "stiffness_N_per_mm");
  EXPECT_THAT(error_of(softer).what, HasSubstr("b-spline"));
  softer.changes[&ContactProperties::stiffness_N_per_mm].reset();
  softer.changes[&ContactProperties::viscosity_N_s_per_mm] = 0.002;
  EXPECT_EQ(error_of(softer).what, "no error");
  live_->next_method();
  EXPECT_EQ(live_->state().method, ForceMethod::kGaussianSphere);
  EXPECT_TRUE(soon([&] { return latest().method == index_of(ForceMethod::kGaussianSphere); }));
  EXPECT_EQ(latest().device[0].flags & kFlagMethodMissing, 0u);
}

TEST_F(Viewed, RampsAreRebuiltForADirectMethod) {
  // fields are not generated before this thread has made its other requests
  std::atomic<bool> may_be_made{false};
  rebuild_fields_ = [&](const Model& model, const Model& made, const Progress& progress) {
    while (!may_be_made && !progress.stopped()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    return with_rebuilt_fields(model, made, progress);
  };
  start(true, {}, std::numeric_limits<double>::infinity(), true);
  TissueRequest softer;
  softer.tissue = kViewedCartilage;
  softer.changes[&ContactProperties::stiffness_N_per_mm] = 0.3;
  SettingsRequest direct;
  direct.method = "trilinear";
  EXPECT_EQ(error_of(softer).what, "no error");
  EXPECT_EQ(error_of(direct).what, "no error");
  EXPECT_EQ(live_->state().method_awaited, "trilinear");
  // the proxy stays active while the fields are generated; the last request wins
  softer.changes[&ContactProperties::stiffness_N_per_mm] = 0.5;
  EXPECT_EQ(error_of(softer).what, "no error");
  may_be_made = true;
  ASSERT_TRUE(soon([&] { return live_->state().method == ForceMethod::kTrilinear; }));
  const auto made = changes();
  ASSERT_GE(made.size(), 3u);
  EXPECT_EQ(made.back().tissue, ModelChange::kFieldsRebuilt);
  EXPECT_EQ(made.back().version, live_->state().model_version);
  ASSERT_NO_FATAL_FAILURE(press(2));
  EXPECT_NEAR(stiffness(), 0.5, 1e-12);
  ASSERT_TRUE(soon([&] { return std::abs(sent_N(latest()) - 1.0) < 0.1; })) << sent_N(latest());
  // the other methods were generated with it
  direct.method = "b-spline";
  EXPECT_EQ(error_of(direct).what, "no error");
  EXPECT_TRUE(soon([&] { return latest().method == index_of(ForceMethod::kSpline); }));
  EXPECT_EQ(changes().size(), made.size()) << "they were made once";
  EXPECT_EQ(latest().device[0].flags & kFlagMethodMissing, 0u);
}

TEST_F(Viewed, ADirectMethodIsMadeReadyWhenItIsChosenFirst) {
  every_method_ = false;
  std::atomic<bool> may_be_made{false};
  std::atomic<int> made{0};
  prepare_methods_ = [&](auto model, auto methods, const Progress& progress) {
    while (!may_be_made && !progress.stopped()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    ++made;
    return with_methods(std::move(model), methods, progress);
  };
  start();
  EXPECT_EQ(live_->scene().methods.size(), kForceMethods.size());
  ASSERT_NO_FATAL_FAILURE(press(1));
  SettingsRequest spline, proxy;
  spline.method = "b-spline";
  proxy.method = "proxy";
  ASSERT_EQ(error_of(spline).what, "no error");
  EXPECT_EQ(live_->state().method, ForceMethod::kProxy);
  EXPECT_EQ(live_->state().method_awaited, "b-spline");
  EXPECT_EQ(live_->method_awaited(), ForceMethod::kSpline);
  // a change in the meantime delays it; the change itself takes effect immediately
  TissueRequest thicker;
  thicker.tissue = kViewedBone;
  thicker.changes[&ContactProperties::viscosity_N_s_per_mm] = 0.002;
  ASSERT_EQ(error_of(thicker).what, "no error");
  may_be_made = true;
  ASSERT_TRUE(soon([&] { return latest().method == index_of(ForceMethod::kSpline); }));
  EXPECT_EQ(live_->state().method_awaited, "");
  EXPECT_EQ(changes().size(), 1u) << "of the tissue: being ready for more is no new version";
  EXPECT_EQ(latest().model_version, 2u);
  // from then on the method is available at once
  ASSERT_EQ(error_of(proxy).what, "no error");
  EXPECT_EQ(live_->state().method, ForceMethod::kProxy);
  const int before = made;
  ASSERT_EQ(error_of(spline).what, "no error");
  EXPECT_EQ(live_->state().method, ForceMethod::kSpline);
  EXPECT_EQ(made, before);
  // no tick rendered another method in its place
  std::vector<std::uint8_t> methods_in_order;
  for (const TickRecord& tick : ticks()) {
    EXPECT_EQ(tick.device[0].flags & kFlagMethodMissing, 0u);
    if (methods_in_order.empty() || methods_in_order.back() != tick.method)
      methods_in_order.push_back(tick.method);
  }
  constexpr auto kNow = static_cast<std::uint8_t>(ForceMethod::kProxy),
                 kThen = static_cast<std::uint8_t>(ForceMethod::kSpline);
  EXPECT_EQ(methods_in_order.front(), kNow);
  EXPECT_EQ(methods_in_order.back(), kThen);
  for (const std::uint8_t method : methods_in_order) EXPECT_TRUE(method == kNow || method == kThen);
}

TEST_F(Viewed, LaterMethodRequestReplacesAPendingOne) {
  every_method_ = false;
  std::atomic<bool> may_be_made{false};
  prepare_methods_ = [&](auto model, auto methods, const Progress& progress) {
    while (!may_be_made && !progress.stopped()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    return with_methods(std::move(model), methods, progress);
  };
  start(true, {}, std::numeric_limits<double>::infinity(), true);
  const auto choose = [&](const char* method) {
    SettingsRequest request;
    request.method = method;
    ASSERT_EQ(error_of(request).what, "no error");
  };
  choose("b-spline");
  choose("smooth-sphere");
  EXPECT_EQ(live_->state().method_awaited, "smooth-sphere");
  may_be_made = true;
  ASSERT_TRUE(soon([&] { return live_->state().method == ForceMethod::kSmoothSphere; }));
  // returning to the previous method cancels the request
  may_be_made = false;
  choose("stored-normals");
  choose("proxy");
  may_be_made = true;
  EXPECT_EQ(live_->state().method_awaited, "");
  // after another change of stiffness the fields are regenerated, including those of a method never chosen
  TissueRequest softer;
  softer.tissue = kViewedCartilage;
  softer.changes[&ContactProperties::stiffness_N_per_mm] = 0.5;
  ASSERT_EQ(error_of(softer).what, "no error");
  choose("gaussian-sphere");
  ASSERT_TRUE(soon([&] { return live_->state().method == ForceMethod::kGaussianSphere; }));
  EXPECT_EQ(changes().back().tissue, ModelChange::kFieldsRebuilt);
  EXPECT_TRUE(soon([&] { return latest().method == index_of(ForceMethod::kGaussianSphere); }));
  EXPECT_EQ(latest().device[0].flags & kFlagMethodMissing, 0u);
}

TEST_F(Viewed, ReportsMethodPreparationFailure) {
  every_method_ = false;
  std::atomic<int> tries{0};
  prepare_methods_ = [&](auto model, auto methods, const Progress& progress) {
    if (++tries == 1) throw std::bad_alloc();
    return with_methods(std::move(model), methods, progress);
  };
  start();
  SettingsRequest spline;
  spline.method = "b-spline";
  ASSERT_EQ(error_of(spline).what, "no error");
  ASSERT_TRUE(soon([&] { return live_->method_failure().has_value(); }));
  EXPECT_EQ(live_->method_failure()->where, "b-spline");
  EXPECT_EQ(live_->state().method, ForceMethod::kProxy);
  EXPECT_EQ(live_->state().method_awaited, "");
  // the memory limit is respected
  set_reading_limits({.max_memory_bytes = 1});
  ASSERT_EQ(error_of(spline).what, "no error");
  ASSERT_TRUE(soon([&] { return live_->method_failure().has_value(); }));
  set_reading_limits({});
  EXPECT_THAT(live_->method_failure()->what, HasSubstr("of memory"));
  EXPECT_EQ(tries, 1);
  ASSERT_EQ(error_of(spline).what, "no error");
  EXPECT_TRUE(soon([&] { return live_->state().method == ForceMethod::kSpline; }));
}

TEST_F(Viewed, LawTakesEffectWhenItsSurfacesAreReady) {
  shell_ = ElasticConstants{60, 0.45};
  std::atomic<bool> may_be_made{false};
  std::atomic<int> made{0};
  prepare_law_ = [&](const Model& model, TissueLaw law, std::size_t devices,
                     const Progress& progress) -> Result<MeasuredCells> {
    while (!may_be_made && !progress.stopped()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    ++made;
    auto under = measured_under_law(model, law, devices, progress);
    if (!under || !is_elastic(law)) return under;
    // as if this machine were too slow for one of the laws
    const bool is_slow = law == TissueLaw::kNeoHookean;
    auto carried = std::make_shared<Model>(*under->model);
    carried->tissue_coarsened = is_slow ? 1.6 : 1;
    return MeasuredCells{std::move(carried), is_slow ? "coarser cells" : ""};
  };
  start();
  EXPECT_THAT(live_->scene().laws,
              ::testing::ElementsAre("elastic", "neo-hookean", "exponential", "chainmail", "layers"));
  ASSERT_NO_FATAL_FAILURE(press(1));
  const auto apply_law = [&](const char* law) {
    SettingsRequest request;
    request.law = law;
    return live_->set(request);
  };
  ASSERT_EQ(apply_law("elastic").value(), RequestOutcome::kDone);
  EXPECT_EQ(live_->state().law, "layers");
  EXPECT_EQ(live_->state().law_awaited, "elastic");
  // returning to the previous law cancels the request
  ASSERT_TRUE(apply_law("layers").ok());
  EXPECT_EQ(live_->state().law_awaited, "");
  ASSERT_TRUE(apply_law("elastic").ok());
  // a tissue edited in the meantime is rendered as edited, and the surfaces include the edit
  TissueRequest slippery;
  slippery.tissue = kViewedCartilage;
  slippery.changes[&ContactProperties::friction] = 0.05;
  ASSERT_EQ(error_of(slippery).what, "no error");
  may_be_made = true;
  ASSERT_TRUE(soon([&] { return live_->state().law == "elastic"; }));
  EXPECT_EQ(live_->state().law_awaited, "");
  EXPECT_FALSE(live_->state().law_failure);
  EXPECT_GE(made, 1);
  EXPECT_EQ(live_->state().tissues[kViewedCartilage].friction, 0.05);
  EXPECT_EQ(changes().back().version, live_->state().model_version);
  EXPECT_EQ(law_of(changes().back()), TissueLaw::kElastic);
  // the solver thread runs, and the tick renders its solution
  ASSERT_TRUE(soon([&] { return latest().solver_frame > 3 && live_->deformation(0) != nullptr; }));
  EXPECT_GT(sent_N(latest()), 0.01);
  EXPECT_EQ(latest().device[0].flags & kFlagInside, 0u);

  // the other elastic law has the same surfaces, but its cell size has not been measured yet
  const int before = made;
  ASSERT_TRUE(apply_law("neo-hookean").ok());
  ASSERT_TRUE(soon([&] { return live_->state().law == "neo-hookean"; }));
  EXPECT_EQ(made, before + 1);
  EXPECT_EQ(changes().back().contact.stiffness_N_per_mm, 1.6);
  EXPECT_EQ(live_->coarser_tissue(), "coarser cells");
  EXPECT_THAT(live_->later_tissue_warnings(), ::testing::ElementsAre("coarser cells"));
  // from then on it takes effect at once
  ASSERT_TRUE(apply_law("elastic").ok());
  EXPECT_EQ(live_->state().law, "elastic");
  EXPECT_EQ(changes().back().contact.stiffness_N_per_mm, 1);
  EXPECT_EQ(live_->coarser_tissue(), "");
  ASSERT_TRUE(apply_law("neo-hookean").ok());
  EXPECT_EQ(live_->state().law, "neo-hookean");
  EXPECT_EQ(made, before + 1);
  ASSERT_TRUE(apply_law("layers").ok());
  ASSERT_TRUE(soon([&] { return live_->state().law == "layers"; }));
  EXPECT_TRUE(soon([&] { return live_->deformation(0) == nullptr; }));
}

TEST_F(Viewed, ReportsLawPreparationFailure) {
  shell_ = ElasticConstants{20, 0.45};
  int tries = 0;
  prepare_law_ = [&](const Model& model, TissueLaw law, std::size_t devices, const Progress& progress) {
    if (++tries == 1) throw std::bad_alloc();
    return measured_under_law(model, law, devices, progress);
  };
  start();
  SettingsRequest elastic;
  elastic.law = "elastic";
  ASSERT_EQ(error_of(elastic).what, "no error");
  ASSERT_TRUE(soon([&] { return live_->state().law_failure.has_value(); }));
  EXPECT_EQ(live_->state().law_failure->where, "elastic");
  EXPECT_EQ(live_->state().law, "layers");
  EXPECT_EQ(live_->state().law_awaited, "");
  // the memory limit is respected
  set_reading_limits({.max_memory_bytes = 1});
  ASSERT_EQ(error_of(elastic).what, "no error");
  ASSERT_TRUE(soon([&] { return live_->state().law_failure.has_value(); }));
  set_reading_limits({});
  EXPECT_THAT(live_->state().law_failure->what, HasSubstr("of memory"));
  ASSERT_EQ(error_of(elastic).what, "no error");
  EXPECT_FALSE(live_->state().law_failure);
  EXPECT_TRUE(soon([&] { return live_->state().law == "elastic"; }));
  // a script's request is answered as well
  live_->change_law_by_script(TissueLaw::kElastic);
  EXPECT_EQ(live_->script_law_version(), live_->state().model_version);
}

// the session continues, viewers are told, and the run replays
TEST_F(Viewed, ReportsSolverOutOfMemory) {
  shell_ = ElasticConstants{60, 0.45};
  std::atomic<bool> is_full{false};
  std::atomic<int> refused{0};
  solve_tissue_ = [&](SoftTissueSolver& solver, const Model& model, const TickRecord& tick) {
    solver.solve(model, tick);
    // the solver is left as after half a frame
    if (is_full && ++refused > 0) throw std::bad_alloc();
  };
  start();
  SettingsRequest elastic;
  elastic.law = "elastic";
  ASSERT_EQ(error_of(elastic).what, "no error");
  ASSERT_TRUE(soon([&] { return live_->state().law == "elastic"; }));
  press(1);
  ASSERT_TRUE(soon([&] { return live_->deformation(0) != nullptr && latest().device[0].contact_N[0] > 0; }));
  // a solution takes some frames to settle
  const std::uint32_t frame = latest().solver_frame;
  ASSERT_TRUE(soon([&] { return latest().solver_frame >= frame + 20; }));
  const double solved_N = latest().device[0].contact_N[0];
  EXPECT_FALSE(live_->state().law_failure);

  is_full = true;
  ASSERT_TRUE(soon([&] { return live_->state().law_failure.has_value(); }));
  EXPECT_EQ(live_->state().law_failure->where, "elastic");
  EXPECT_THAT(live_->state().law_failure->what, HasSubstr("memory ran out"));
  EXPECT_EQ(live_->state().law, "elastic");
  EXPECT_TRUE(soon([&] { return live_->deformation(0) == nullptr; }));
  // 3 mm of tissue on bone are stiffer than a half-space of it
  EXPECT_TRUE(soon([&] {
    const double N = latest().device[0].contact_N[0];
    return N > 0 && N < 0.98 * solved_N;
  })) << latest().device[0].contact_N[0]
      << " N after " << solved_N;
  ASSERT_TRUE(soon([&] { return refused >= 2; })) << "it is tried again";

  is_full = false;
  ASSERT_TRUE(soon([&] { return !live_->state().law_failure && live_->deformation(0) != nullptr; }));
  EXPECT_TRUE(soon([&] { return std::abs(latest().device[0].contact_N[0] / solved_N - 1) < 0.01; }))
      << latest().device[0].contact_N[0] << " N after " << solved_N;

  live_->end();
  EXPECT_THAT(live_->later_tissue_warnings(), ::testing::Contains(HasSubstr("memory ran out")));
  loop_->stop();
  Recording recording;
  recording.header.model_hash = model_->content_hash;
  recording.header.model_version = model_->version;
  recording.header.tissue_coarsened = model_->tissue_coarsened;
  recording.ticks = ticks();
  recording.events.assign(reported().begin(), reported().end());
  const auto replayed = replay(recording, model_);
  ASSERT_TRUE(replayed.ok()) << replayed.error().message();
  EXPECT_TRUE(replayed->identical) << replayed->difference;
}

TEST_F(Viewed, ReturningToTheProxyCancelsPreparation) {
  start(true, {}, std::numeric_limits<double>::infinity(), true);
  TissueRequest softer;
  softer.tissue = kViewedBone;
  softer.changes[&ContactProperties::stiffness_N_per_mm] = 1.0;
  ASSERT_EQ(error_of(softer).what, "no error");
  live_->next_method();  // the method after the proxy is the trilinear one
  SettingsRequest proxy;
  proxy.method = "proxy";
  ASSERT_EQ(error_of(proxy).what, "no error");
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  EXPECT_EQ(live_->state().method, ForceMethod::kProxy);
  // a script's method gets its fields
  loop_->change([](Parameters& parameters) { parameters.method = ForceMethod::kSmoothSphere; });
  ASSERT_TRUE(soon([&] {
    live_->follow_script();
    const TickRecord tick = latest();
    return tick.method == index_of(ForceMethod::kSmoothSphere) && tick.model_version >= 3 &&
           (tick.device[0].flags & kFlagMethodMissing) == 0;
  }));
}

// a session by the proxy starts without the field of the direct methods and makes it on demand, beside the
// loop and without a new version of the model
TEST_F(Viewed, ProxySessionBuildsTheFieldOnDemand) {
  proxy_alone_ = true;
  prepare_methods_ = [](auto model, auto methods, const Progress& progress) {
    return prepared_for(std::move(model), methods, {}, progress);
  };
  start(true, {}, std::numeric_limits<double>::infinity(), true);
  press(1);
  EXPECT_FALSE(model_->has(ForceMethod::kTrilinear));
  const double by_proxy_N = sent_N(latest());
  EXPECT_GT(by_proxy_N, 0.5);
  SettingsRequest request;
  for (const char* direct : {"trilinear", "b-spline", "proxy", "trilinear"}) {
    request.method = direct;
    ASSERT_EQ(error_of(request).what, "no error");
    const ForceMethod method = *find_force_method(direct);
    ASSERT_TRUE(soon([&] { return latest().method == index_of(method); })) << direct;
    EXPECT_FALSE(live_->state().method_failure) << direct;
    EXPECT_TRUE(soon([&] {
      const TickRecord now = latest();
      return (now.device[0].flags & (kFlagBlend | kFlagMethodMissing)) == 0;
    })) << direct;
    EXPECT_NEAR(sent_N(latest()), by_proxy_N, 0.25 * by_proxy_N) << direct;
  }
  EXPECT_TRUE(changes().empty()) << "a prepared method is no other model";
  for (const TickRecord& tick : ticks()) EXPECT_EQ(tick.device[0].flags & kFlagMethodMissing, 0u);
}

TEST_F(Viewed, ProxySessionBuildsTheFieldForTheCurrentStiffness) {
  proxy_alone_ = true;
  start(true, {}, std::numeric_limits<double>::infinity(), true);
  TissueRequest softer;
  softer.tissue = kViewedCartilage;
  softer.changes[&ContactProperties::stiffness_N_per_mm] = 0.3;
  ASSERT_EQ(error_of(softer).what, "no error");
  SettingsRequest direct;
  direct.method = "trilinear";
  ASSERT_EQ(error_of(direct).what, "no error");
  ASSERT_TRUE(soon([&] { return live_->state().method == ForceMethod::kTrilinear; }));
  const auto made = changes();
  ASSERT_EQ(made.size(), 2u);
  EXPECT_EQ(made[1].tissue, ModelChange::kFieldsRebuilt);
}

// out of memory, unsuitable values: the session continues, and the error is reported
TEST_F(Viewed, ReportsFieldPreparationFailure) {
  using Made = Result<std::shared_ptr<const Model>>;
  std::atomic<int> tries{0};
  rebuild_fields_ = [&](const Model& model, const Model& made, const Progress& progress) -> Made {
    switch (++tries) {
      case 1:
        throw std::bad_alloc();
      case 2:
        throw std::runtime_error("no thread");
      case 3:
        return Error{ErrorKind::kBadInput, "the shell is too thin", "label 2", "make it thicker"};
      case 4:
        return with_rebuilt_fields(model, made, progress);
      default: {
        // a model with the one method that a tick requires
        auto bare = std::make_shared<Model>(model);
        bare->methods = {};
        bare->methods[index_of(ForceMethod::kTrilinear)] = model.methods[index_of(ForceMethod::kTrilinear)];
        return std::shared_ptr<const Model>(std::move(bare));
      }
    }
  };
  start(true, {}, std::numeric_limits<double>::infinity(), true);
  TissueRequest softer;
  softer.tissue = kViewedCartilage;
  softer.changes[&ContactProperties::stiffness_N_per_mm] = 0.3;
  ASSERT_EQ(error_of(softer).what, "no error");
  SettingsRequest direct;
  direct.method = "b-spline";
  for (const char* why : {"bad_alloc", "no thread", "the shell is too thin"}) {
    ASSERT_EQ(error_of(direct).what, "no error");
    ASSERT_TRUE(soon([&] { return live_->state().method_failure.has_value(); })) << why;
    const ViewedState state = live_->state();
    EXPECT_THAT(state.method_failure->what, HasSubstr(why));
    EXPECT_EQ(state.method_failure->where, "b-spline");
    EXPECT_FALSE(state.method_failure->remedy.empty());
    EXPECT_EQ(state.method, ForceMethod::kProxy);
    EXPECT_EQ(state.method_awaited, "");
    EXPECT_TRUE(loop_->running());
  }
  // another attempt may succeed
  ASSERT_EQ(error_of(direct).what, "no error");
  EXPECT_FALSE(live_->state().method_failure);
  EXPECT_TRUE(soon([&] { return live_->state().method == ForceMethod::kSpline; }));
  EXPECT_EQ(live_->state().method_awaited, "");

  // a method missing in the new fields is prepared separately
  SettingsRequest proxy;
  proxy.method = "proxy";
  ASSERT_EQ(error_of(proxy).what, "no error");
  softer.changes[&ContactProperties::stiffness_N_per_mm] = 0.4;
  ASSERT_EQ(error_of(softer).what, "no error");
  ASSERT_EQ(error_of(direct).what, "no error");
  EXPECT_TRUE(soon([&] { return live_->state().method == ForceMethod::kSpline; }));
  EXPECT_EQ(tries, 5);
}

// a script's method that cannot be prepared is replaced by the proxy
TEST_F(Viewed, ReportsMethodFailureOfAScript) {
  std::atomic<int> tries{0};
  rebuild_fields_ = [&](const auto&...) -> Result<std::shared_ptr<const Model>> {
    ++tries;
    throw std::bad_alloc();
  };
  start(true, {}, std::numeric_limits<double>::infinity(), true);
  TissueRequest softer;
  softer.tissue = kViewedBone;
  softer.changes[&ContactProperties::stiffness_N_per_mm] = 1.0;
  ASSERT_EQ(error_of(softer).what, "no error");
  loop_->change([](Parameters& parameters) { parameters.method = ForceMethod::kSmoothSphere; });
  ASSERT_TRUE(soon([&] {
    live_->follow_script();
    return live_->method_failure().has_value();
  }));
  EXPECT_EQ(live_->method_failure()->where, "smooth-sphere");
  EXPECT_EQ(live_->state().method, ForceMethod::kProxy);
  EXPECT_TRUE(soon([&] { return latest().method == index_of(ForceMethod::kProxy); }));
  // no repeated attempts
  loop_->change([](Parameters& parameters) { parameters.method = ForceMethod::kSpline; });
  for (int n = 0; n < 10; ++n) live_->follow_script();
  EXPECT_EQ(live_->state().method_awaited, "");
  EXPECT_EQ(live_->method_failure()->where, "b-spline");
  EXPECT_EQ(live_->state().method, ForceMethod::kProxy);
  EXPECT_EQ(tries, 1);
}

TEST_F(Viewed, ReportsAScriptsMethodWithStaleFields) {
  start();
  TissueRequest softer;
  softer.tissue = kViewedBone;
  softer.changes[&ContactProperties::stiffness_N_per_mm] = 1.0;
  ASSERT_EQ(error_of(softer).what, "no error");
  loop_->change([](Parameters& parameters) { parameters.method = ForceMethod::kSpline; });
  live_->follow_script();
  ASSERT_TRUE(live_->method_failure());
  EXPECT_EQ(live_->method_failure()->where, "b-spline");
  EXPECT_THAT(live_->method_failure()->what, HasSubstr("other stiffness values"));
  EXPECT_EQ(live_->state().method, ForceMethod::kProxy);
}

// ---- a physical device

TEST_F(Viewed, ViewerRequestsNeedConsentWhileADeviceIsArmed) {
  start(false);
  EXPECT_FALSE(live_->scene().simulated);
  EXPECT_TRUE(live_->state().armed);
  const Parameters before = loop_->parameters();
  const auto one = [](const auto& set) {
    SettingsRequest request;
    request.by = {3, true};
    request.id = 12;
    set(request);
    return request;
  };
  const std::pair<SettingsRequest, const char*> wishes[] = {
      {one([](auto& r) {
         r.rotation_wxyz = {std::cos(0.2), 0, 0, std::sin(0.2)};
       }),
       "viewer 3 wants to turn the object by 22.9 degrees"},
      {one([](auto& r) { r.paused = true; }), "viewer 3 wants to pause the force"},
      {one([](auto& r) { r.max_force_N = 2; }), "viewer 3 wants to set the force limit to 2 N, now 3"},
      {one([](auto& r) { r.max_force_N = 4; }), "viewer 3 wants to set the force limit to 4 N, now 3"},
      {one([](auto& r) { r.method = "trilinear"; }), "viewer 3 wants to use the method trilinear"},
      {one([](auto& r) {
         r.friction = false;
         r.viscosity = false;
         r.passivity = true;
       }),
       "viewer 3 wants to switch friction off, and switch viscosity off, and switch the passivity controller "
       "on"}};
  for (const auto& [wish, words] : wishes) {
    SCOPED_TRACE(words);
    const auto granted = live_->set(wish);
    ASSERT_TRUE(granted.ok());
    EXPECT_EQ(*granted, RequestOutcome::kAwaitingConsent);
    ASSERT_TRUE(live_->question());
    EXPECT_EQ(live_->question()->text, words);
    // declined: nothing has changed
    const LateAnswer requested = answer(false);
    EXPECT_FALSE(requested.outcome.ok());
    EXPECT_EQ(requested.id, 12);
    const Parameters now = loop_->parameters();
    EXPECT_EQ(now.rotation_target.coeffs(), before.rotation_target.coeffs());
    EXPECT_EQ(now.method, before.method);
    EXPECT_EQ(now.paused, before.paused);
    EXPECT_EQ(now.max_force_N, before.max_force_N);
    EXPECT_EQ(switches_of(now), switches_of(before));
  }
  EXPECT_TRUE(reported().empty());

  // agreed to: it takes effect, and the recording names the consent
  ASSERT_TRUE(live_->set(wishes[0].first).ok());
  EXPECT_TRUE(answer(true).outcome.ok());
  EXPECT_NEAR(loop_->parameters().rotation_target.z(), std::sin(0.2), 1e-12);
  ASSERT_EQ(reported().size(), 1u);
  EXPECT_EQ(reported().back().by, (RequestedBy{Originator::kViewerWithConsent, 3}));
  EXPECT_EQ(reported().back().changed, kSettingRotation);

  // a request for the current value changes nothing and needs no consent
  const auto same = live_->set(wishes[0].first);
  EXPECT_TRUE(same.ok() && *same == RequestOutcome::kDone);
  EXPECT_FALSE(live_->question());
  // and an invalid request is refused immediately
  SettingsRequest wild;
  wild.max_force_N = 99;
  EXPECT_EQ(error_of(wild).where, "max_force_N");
}

TEST_F(Viewed, TissuesWaitForConsentToo) {
  start(false);
  TissueRequest request;
  request.by = {5, true};
  request.id = 3;
  request.tissue = kViewedCartilage;
  request.changes[&ContactProperties::stiffness_N_per_mm] = 0.5;
  request.changes[&ContactProperties::static_friction] = 0.4;
  const auto granted = live_->set(request);
  ASSERT_TRUE(granted.ok() && *granted == RequestOutcome::kAwaitingConsent);
  EXPECT_EQ(live_->question()->text,
            "viewer 5 wants to change cartilage's stiffness from 0.75 to 0.5 N/mm, and change its static "
            "friction from 0.1 to 0.4");
  EXPECT_EQ(live_->state().model_version, 1u);
  EXPECT_TRUE(answer(true).outcome.ok());
  EXPECT_EQ(live_->state().model_version, 2u);
  EXPECT_EQ(live_->state().tissues[kViewedCartilage].stiffness_N_per_mm, 0.5);
  ASSERT_EQ(reported().size(), 1u);
  EXPECT_EQ(reported().back().by, (RequestedBy{Originator::kViewerWithConsent, 5}));

  // a request that has become impossible in the meantime is refused despite consent
  request.changes[&ContactProperties::stiffness_N_per_mm] = 0.6;
  ASSERT_TRUE(live_->set(request).ok());
  loop_->change([](Parameters& parameters) { parameters.method = ForceMethod::kTrilinear; });
  EXPECT_EQ(answer(true).outcome.error().where, "stiffness_N_per_mm");
  EXPECT_EQ(live_->state().model_version, 2u);
}

TEST_F(Viewed, WithoutAnybodyToAskNothingIsChangedFromAfar) {
  asks_here_ = false;
  start(false);
  SettingsRequest request;
  request.rotation_wxyz = {std::cos(0.2), 0, 0, std::sin(0.2)};
  EXPECT_THAT(error_of(request).what, HasSubstr("cannot be confirmed"));
  EXPECT_FALSE(error_of(request).remedy.empty());
  EXPECT_EQ(loop_->parameters().rotation_target.z(), 0);
  // a stop needs no consent
  live_->emergency_stop({3, false});
  stopped();
}

// while stopped, only changes that could increase the force later need consent
TEST_F(Viewed, WhileItIsStoppedOnlyMoreNeedsConsent) {
  start(false);
  live_->emergency_stop({3, false});
  stopped();
  EXPECT_FALSE(live_->state().armed);
  SettingsRequest request;
  request.rotation_wxyz = {std::cos(0.2), 0, 0, std::sin(0.2)};
  request.max_force_N = 2;
  request.friction = false;
  request.paused = true;
  EXPECT_EQ(*live_->set(request), RequestOutcome::kDone);
  EXPECT_EQ(live_->state().max_force_N, 2);
  const auto wants = [&](const auto& set) {
    SettingsRequest more;
    set(more);
    return *live_->set(more);
  };
  EXPECT_EQ(wants([](auto& r) { r.max_force_N = 2.5; }), RequestOutcome::kAwaitingConsent);
  EXPECT_EQ(wants([](auto& r) { r.friction = true; }), RequestOutcome::kAwaitingConsent);
  EXPECT_EQ(wants([](auto& r) { r.paused = false; }), RequestOutcome::kAwaitingConsent);
  TissueRequest stiffer;
  stiffer.changes[&ContactProperties::stiffness_N_per_mm] = 1.6;
  EXPECT_EQ(*live_->set(stiffer), RequestOutcome::kAwaitingConsent);
  stiffer.changes[&ContactProperties::stiffness_N_per_mm] = 1.4;
  EXPECT_EQ(*live_->set(stiffer), RequestOutcome::kDone);
  EXPECT_EQ(live_->state().max_force_N, 2);
}

TEST_F(Viewed, DisconnectedViewerWithdrawsItsRequest) {
  start(false);
  SettingsRequest request;
  request.by = {6, true};
  request.paused = true;
  ASSERT_EQ(*live_->set(request), RequestOutcome::kAwaitingConsent);
  live_->forget(request.by);
  EXPECT_FALSE(live_->question());
  EXPECT_TRUE(live_->read_answers().empty());
}

TEST_F(Viewed, APhysicalDeviceIsArmedWhereItIs) {
  start(false);
  live_->emergency_stop({3, false});
  const std::uint32_t stop = stopped();
  EXPECT_THAT(error_in(live_->rearm({stop, {4, true}})).what, HasSubstr("at the device"));
  EXPECT_EQ(live_->state().stop, stop);
  // a code that was never displayed is invalid
  EXPECT_EQ(error_in(live_->rearm({stop, {4, true}, "000000"})).where, "code");
  EXPECT_EQ(live_->state().stop, stop);
  EXPECT_EQ(error_in(live_->rearm_by_key(stop)).what, "no error");
  EXPECT_TRUE(soon([&] { return (latest().switches & kSwitchEmergencyStop) == 0; }));
  EXPECT_TRUE(live_->state().armed);
  EXPECT_EQ(error_in(live_->claim_pointer(true, {1, true})).kind, ErrorKind::kUsage);
}

TEST_F(Viewed, ACodeThatIsShownThereArmsAPhysicalDeviceOnce) {
  start(false);
  EXPECT_EQ(live_->arming_code(), "") << "nothing is stopped";
  live_->emergency_stop({3, false});
  std::uint32_t stop = stopped();
  const std::string code = live_->arming_code();
  ASSERT_EQ(code.size(), 6u);
  EXPECT_EQ(error_in(live_->rearm({stop, {4, true}, code})).what, "no error");
  EXPECT_TRUE(soon([&] { return (latest().switches & kSwitchEmergencyStop) == 0; }));
  EXPECT_EQ(live_->arming_code(), "");
  live_->emergency_stop({3, false});
  stop = stopped();
  EXPECT_EQ(error_in(live_->rearm({stop, {4, true}, code})).where, "code") << "of the stop before";
  EXPECT_EQ(live_->state().stop, stop);
  const std::string next = live_->arming_code();
  EXPECT_EQ(error_in(live_->rearm({stop - 1, {4, true}, next})).where, "code") << "of another stop";
  EXPECT_EQ(error_in(live_->rearm({stop, {4, true}, live_->arming_code()})).what, "no error");
}

// ---- a stop, and its end

TEST_F(Viewed, ASimulatedDeviceIsRearmedFromAfar) {
  start();
  EXPECT_FALSE(live_->state().armed);
  live_->emergency_stop({3, false});
  const std::uint32_t stop = stopped();
  EXPECT_EQ(error_in(live_->rearm({stop, {4, true}})).what, "no error");
  EXPECT_TRUE(soon([&] { return (latest().switches & kSwitchEmergencyStop) == 0; }));
  EXPECT_FALSE(live_->state().stop);
}

// Regression: a key toggled between stop and rearm, so that it re-armed after a viewer's stop and two quick
// presses ended armed.
TEST_F(Viewed, StopsAreIdempotentFromAnySource) {
  for (const bool simulated : {false, true}) {
    start(simulated);
    live_->emergency_stop({3, false});
    live_->stop_by_key();
    live_->stop_by_key();
    live_->emergency_stop({4, true});
    const std::uint32_t last = stopped();
    EXPECT_EQ(last, 4u);
    // originator of the current stop
    EXPECT_EQ(live_->state().stopped_by, StoppedBy::kViewer);
    EXPECT_EQ(live_->state().stopped_by_viewer, 4u);
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    EXPECT_TRUE(latest().switches & kSwitchEmergencyStop);
    // a rearm sent before the last stop was noticed
    EXPECT_THAT(error_in(live_->rearm_by_key(last - 1)).what, HasSubstr("another stop"));
    EXPECT_EQ(live_->state().stop, last);
    EXPECT_EQ(error_in(live_->rearm_by_key(last)).what, "no error");
    EXPECT_THAT(error_in(live_->rearm_by_key(last)).what, HasSubstr("not stopped"));
    TearDown();
    reported_.clear();
  }
}

TEST_F(Viewed, OnlyAFreeHandGetsItsForceBack) {
  start();
  ASSERT_NO_FATAL_FAILURE(press(1));
  ASSERT_TRUE(soon([&] { return sent_N(latest()) > 0.3; }));
  live_->stop_by_key();
  const std::uint32_t stop = stopped();
  EXPECT_EQ(live_->state().stopped_by, StoppedBy::kKey);
  EXPECT_EQ(sent_N(latest()), 0);
  for (const auto& refused : {live_->rearm_by_key(stop), live_->rearm({stop, {4, true}})}) {
    EXPECT_THAT(error_in(refused).what, HasSubstr("is in contact"));
    EXPECT_THAT(error_in(refused).remedy, HasSubstr("free"));
  }
  ASSERT_NO_FATAL_FAILURE(leave());
  EXPECT_EQ(error_in(live_->rearm_by_key(stop)).what, "no error");
  EXPECT_TRUE(soon([&] { return (latest().switches & kSwitchEmergencyStop) == 0; }));
}

TEST_F(Viewed, EventsRecordTheirOriginator) {
  start();
  SettingsRequest settings;
  settings.by = {7, true};
  settings.friction = false;
  settings.max_force_N = 2.5;
  EXPECT_EQ(error_of(settings).what, "no error");
  EXPECT_EQ(error_of(settings).what, "no error");
  settings.max_force_N = 99;
  EXPECT_EQ(error_of(settings).where, "max_force_N");
  TissueRequest softer;
  softer.by = {8, true};
  softer.tissue = kViewedCartilage;
  softer.changes[&ContactProperties::static_friction] = 0.35;
  EXPECT_EQ(error_of(softer).what, "no error");
  live_->emergency_stop({9, false});
  EXPECT_EQ(error_in(live_->rearm({stopped(), {7, true}})).what, "no error");
  live_->stop_by_key();
  EXPECT_EQ(error_in(live_->rearm_by_key(99)).where, "stop") << "which is told to nobody";
  EXPECT_EQ(error_in(live_->rearm_by_key(stopped())).what, "no error");
  live_->pause_by_key();
  live_->next_method();

  using Kind = RecordingEvent::Kind;
  const std::vector<RecordingEvent> events(reported().begin(), reported().end());
  ASSERT_EQ(events.size(), 9u) << "what was refused is not told";
  const auto expect = [&](std::size_t index, Kind kind, RequestedBy by, std::uint32_t number) {
    EXPECT_EQ(events[index].kind, kind) << index;
    EXPECT_EQ(events[index].by, by) << index;
    EXPECT_EQ(events[index].number, number) << index;
  };
  expect(0, Kind::kSettings, {Originator::kControlViewer, 7}, 1);
  EXPECT_EQ(events[0].changed, kSettingFriction | kSettingMaxForce);
  EXPECT_EQ(events[0].switches, kSwitchViscosity);
  EXPECT_EQ(events[0].max_force_N, 2.5);
  expect(1, Kind::kSettings, {Originator::kControlViewer, 7}, 2);
  EXPECT_EQ(events[1].changed, 0) << "it held already";
  expect(2, Kind::kModel, {Originator::kControlViewer, 8}, 2);
  EXPECT_EQ(events[2].change.contact.static_friction, 0.35);
  expect(3, Kind::kStop, {Originator::kViewingViewer, 9}, 1);
  expect(4, Kind::kRearm, {Originator::kControlViewer, 7}, 2);
  expect(5, Kind::kStop, {Originator::kKey, 0}, 3);
  expect(6, Kind::kRearm, {Originator::kKey, 0}, 4);
  expect(7, Kind::kSettings, {Originator::kKey, 0}, 3);
  EXPECT_EQ(events[7].changed, kSettingPaused);
  EXPECT_EQ(events[7].switches, kSwitchViscosity | kSwitchPaused);
  expect(8, Kind::kSettings, {Originator::kKey, 0}, 4);
  EXPECT_EQ(events[8].changed, kSettingMethod);
  // and ticks acknowledge it
  EXPECT_TRUE(soon([&] {
    const TickRecord tick = latest();
    return tick.settings_number == 4 && tick.arming_number == 4 && tick.model_version == 2;
  }));
}

TEST_F(Viewed, BeforeItRunsItShowsAndRefuses) {
  DeviceInfo info;
  info.simulated = true;
  LiveSession live(LiveSessionParts{
      std::make_shared<const Model>(testing::ball_model({2, 2, 2})), {info}, {}, {}, "script"});
  std::array<double, kMaxDevices> stiffness_N_per_mm{};
  EXPECT_EQ(live.snapshot(stiffness_N_per_mm).tick, 0u);
  EXPECT_EQ(live.health().rate_hz, 0);
  EXPECT_EQ(live.state().model_version, 1u);
  EXPECT_EQ(error_in(live.set(SettingsRequest{})).kind, ErrorKind::kUnavailable);
  EXPECT_EQ(error_in(live.set(TissueRequest{})).kind, ErrorKind::kUnavailable);
  EXPECT_EQ(error_in(live.rearm(RearmRequest{})).kind, ErrorKind::kUnavailable);
}

// ---- a whole session, recorded

class ViewedExplore : public ::testing::Test {
 protected:
  // calls `act` fifty times a second with the session; returns its recording
  Recording run(ExploreOptions options, const std::string& script_text,
                const std::function<void(LiveHost&, int)>& act) {
    LiveHost* host = nullptr;
    int calls = 0;
    options.loop.realtime = false;
    options.viewers = [&](LiveHost& session) -> Result<std::shared_ptr<void>> {
      host = &session;
      return std::shared_ptr<void>(&session, [&](void*) { host = nullptr; });
    };
    options.request = [&] {
      act(*host, calls++);
      return ExploreRequest::kNone;
    };
    auto script = parse_script(script_text, "test script");
    PALPATE_CHECK(script.ok());
    const auto file = folder_ / "run.h5";
    auto result = explore(loaded_, *script, options, file, Progress({}, &stop_));
    PALPATE_CHECK(result.ok());
    result_ = *result;
    EXPECT_EQ(host, nullptr) << "viewers leave before the session ends";
    auto read = read_recording(file);
    PALPATE_CHECK(read.ok() && read->summary);
    return *std::move(read);
  }
  static std::vector<ModelChange> changes_in(const Recording& recording) {
    std::vector<ModelChange> changes;
    for (const RecordingEvent& event : recording.events)
      if (event.kind == RecordingEvent::Kind::kModel) changes.push_back(event.change);
    return changes;
  }
  static ModelChange& first_change(Recording& recording) {
    return std::find_if(
               recording.events.begin(), recording.events.end(),
               [](const RecordingEvent& event) { return event.kind == RecordingEvent::Kind::kModel; })
        ->change;
  }
  // each event is recorded with the first tick to which its values apply; several events of one tick with the
  // last values
  static void expect_events_where_they_took_hold(const Recording& recording) {
    for (std::size_t e = 0; e < recording.events.size(); ++e) {
      const RecordingEvent& event = recording.events[e];
      const TickRecord& tick = recording.ticks.at(event.tick);
      ASSERT_EQ(tick.tick, event.tick);
      if (event.kind == RecordingEvent::Kind::kModel) {
        EXPECT_GE(tick.model_version, event.number);
        EXPECT_LT(recording.ticks.at(event.tick - 1).model_version, event.number);
      }
      const bool last = std::none_of(
          recording.events.begin() + static_cast<std::ptrdiff_t>(e) + 1, recording.events.end(),
          [&](const RecordingEvent& later) { return later.kind == event.kind && later.tick == event.tick; });
      if (event.kind != RecordingEvent::Kind::kSettings || !last) continue;
      EXPECT_EQ(tick.method, event.method);
      EXPECT_EQ(tick.switches & ~kSwitchEmergencyStop, event.switches);
      EXPECT_EQ(tick.max_force_N, event.max_force_N);
      EXPECT_EQ(tick.rotation_target_wxyz, event.rotation_target_wxyz);
    }
  }
  void expect_replays(const Recording& recording) {
    const auto again = replay(recording, loaded_.model);
    ASSERT_TRUE(again.ok()) << again.error().message();
    EXPECT_TRUE(again->identical) << again->difference;
    EXPECT_EQ(again->run_hash, recording.summary->run_hash);
  }

  test::TemporaryFolder folder_;
  LoadedScene loaded_ = testing::loaded_ball();
  std::atomic<bool> stop_{false};
  std::optional<ExploreResult> result_;
};

const char* const kPressAndHold =
    "[[step]]\napproach = \"ball\"\nspeed = 200.0\n[[step]]\npress = 0.8\n[[step]]\nhold = 60.0\n";

TEST_F(ViewedExplore, RemovalIsShownRecordedAndReplayed) {
  loaded_ = testing::loaded_burr();
  ExploreOptions options;
  options.seconds = 60;
  std::vector<SweepRecord> shown;
  bool on = false, softened = false;
  const Recording recording = run(options, kPressAndHold, [&](LiveHost& host, int) {
    std::array<double, kMaxDevices> stiffnesses{};
    const TickRecord tick = host.snapshot(stiffnesses);
    SettingsRequest motor;
    motor.motor = true;
    if (!on && sent_N(tick) > 0.5) {
      EXPECT_EQ(host.state().sweeps, 0u);
      ASSERT_TRUE(host.set(motor).ok());
      EXPECT_TRUE(host.state().motor);
      // the fields of direct methods do not follow the removal
      SettingsRequest direct;
      direct.method = "trilinear";
      EXPECT_EQ(host.set(direct).error().where, "method");
      on = true;
    }
    const std::uint32_t version = host.state().model_version;
    for (const SweepRecord& sweep : host.sweeps(version, shown.size(), 7)) shown.push_back(sweep);
    // a tissue is changed between two cuts
    if (!softened && shown.size() > 10) {
      TissueRequest softer;
      softer.changes[&ContactProperties::stiffness_N_per_mm] = 1.2;
      ASSERT_TRUE(host.set(softer).ok());
      softened = true;
    }
    if (shown.size() > 40) {
      motor.motor = false;
      ASSERT_TRUE(host.set(motor).ok());
      stop_.store(true);
    }
  });
  EXPECT_TRUE(softened);
  const auto changes = changes_in(recording);
  EXPECT_GT(std::ranges::count(changes, ModelChange::kCut, &ModelChange::tissue), 3);
  EXPECT_EQ(std::ranges::count(changes, 0u, &ModelChange::tissue), 1);
  std::size_t sweeps = 0;
  for (const RecordingEvent& event : recording.events) {
    if (event.kind != RecordingEvent::Kind::kSweep) continue;
    if (sweeps < shown.size()) {
      EXPECT_EQ(event.sweep, shown[sweeps]) << sweeps;
    }
    ++sweeps;
  }
  EXPECT_GE(sweeps, shown.size());
  expect_replays(recording);
}

TEST_F(ViewedExplore, AnUndoIsOfNoStrokeThatIsBegunAfterIt) {
  loaded_ = testing::loaded_burr();
  ExploreOptions options;
  options.seconds = 60;
  enum class At { kBefore, kFirst, kStopped, kSecond, kOver } at = At::kBefore;
  std::chrono::steady_clock::time_point over;
  bool stands = false;
  const auto of_second = [](const SweepRecord& sweep) { return sweep.stroke == 2; };
  run(options, kPressAndHold, [&](LiveHost& host, int) {
    std::array<double, kMaxDevices> stiffness_N_per_mm{};
    const TickRecord tick = host.snapshot(stiffness_N_per_mm);
    const ViewedState state = host.state();
    const auto sweeps = host.sweeps(state.model_version, 0, 10000);
    SettingsRequest motor;
    if (at == At::kBefore && sent_N(tick) > 0.5) {
      motor.motor = true;
      at = At::kFirst;
    } else if (at == At::kFirst && sweeps.size() > 20) {
      EXPECT_TRUE(state.motor_is_on);
      motor.motor = false;
      at = At::kStopped;
    } else if (at == At::kStopped && !state.motor_is_on) {
      EXPECT_TRUE(host.set(StrokeRequest{StrokeAction::kUndo, {3, true}, 1}).ok());
      motor.motor = true;
      at = At::kSecond;
    } else if (at == At::kSecond && std::ranges::any_of(sweeps, of_second)) {
      motor.motor = false;
      at = At::kOver;
      over = std::chrono::steady_clock::now();
    } else if (at == At::kOver && std::chrono::steady_clock::now() - over > std::chrono::milliseconds(200)) {
      // by then it would be undone
      stands = std::ranges::any_of(sweeps, of_second);
      stop_.store(true);
    }
    if (motor.motor) {
      ASSERT_TRUE(host.set(motor).ok());
    }
  });
  EXPECT_TRUE(stands);
}

TEST_F(ViewedExplore, StrokeIsUndoneAndRedoneDuringContact) {
  loaded_ = testing::loaded_burr();
  ExploreOptions options;
  options.seconds = 60;
  enum class At { kBefore, kCut, kStopped, kUndone, kDoneAgain } at = At::kBefore;
  std::uint64_t cut = 0;
  double gone_mm3 = 0;
  const ViewerIdentity viewer{3, true};
  const Recording recording = run(options, kPressAndHold, [&](LiveHost& host, int) {
    std::array<double, kMaxDevices> stiffness_N_per_mm{};
    const TickRecord tick = host.snapshot(stiffness_N_per_mm);
    const ViewedState state = host.state();
    SettingsRequest motor;
    const StrokeRequest undo{StrokeAction::kUndo, viewer, 1}, redo{StrokeAction::kRedo, viewer, 2};
    if (at == At::kBefore && sent_N(tick) > 0.5) {
      EXPECT_NE(host.set(undo).error().what.find("no stroke"), std::string::npos);
      motor.motor = true;
      ASSERT_TRUE(host.set(motor).ok());
      at = At::kCut;
    } else if (at == At::kCut && state.sweeps > 20) {
      EXPECT_EQ(host.set(undo).error().where, "motor") << "the stroke is not over";
      motor.motor = false;
      ASSERT_TRUE(host.set(motor).ok());
      at = At::kStopped;
    } else if (at == At::kStopped && (tick.switches & kSwitchMotor) == 0) {
      // sweeps of that stroke not yet removed are undone with it
      EXPECT_EQ(state.strokes_to_undo, 1u);
      ASSERT_TRUE(host.set(undo).ok());
      EXPECT_FALSE(host.set(undo).ok()) << "it is wanted already";
      at = At::kUndone;
    } else if (at == At::kUndone && state.strokes_to_redo == 1) {
      EXPECT_EQ(state.sweeps, 0u);
      EXPECT_EQ(state.undone_to, std::vector<std::uint64_t>{0});
      EXPECT_TRUE(state.removed_mm3.empty());
      EXPECT_EQ(host.set(undo).ok(), false);
      ASSERT_TRUE(host.set(redo).ok());
      at = At::kDoneAgain;
    } else if (at == At::kDoneAgain && state.strokes_to_undo == 1) {
      cut = state.sweeps;
      gone_mm3 = state.removed_mm3.at(testing::kBone);
      stop_.store(true);
    }
  });
  EXPECT_GT(cut, 20u);
  EXPECT_GT(gone_mm3, 0.1);
  std::uint64_t sweeps = 0;
  std::vector<std::uint32_t> strokes;
  for (const RecordingEvent& event : recording.events) {
    sweeps += event.kind == RecordingEvent::Kind::kSweep;
    if (event.kind != RecordingEvent::Kind::kModel || !event.change.is_of_stroke()) continue;
    strokes.push_back(event.change.tissue);
    EXPECT_EQ(event.by, (RequestedBy{Originator::kControlViewer, 3}));
  }
  EXPECT_EQ(sweeps, cut);
  EXPECT_EQ(strokes, (std::vector{ModelChange::kUndo, ModelChange::kRedo}));
  expect_replays(recording);
}

TEST_F(ViewedExplore, ViewerChangesAreRecordedAndReplayed) {
  ExploreOptions options;
  options.seconds = 60;
  int changed_at = -1, turned_at = -1;
  double softened_N = 0, reported = 0;
  const Recording recording = run(options, kPressAndHold, [&](LiveHost& host, int call) {
    std::array<double, kMaxDevices> stiffnesses{};
    const TickRecord tick = host.snapshot(stiffnesses);
    if (changed_at < 0 && sent_N(tick) > 0.5) {
      TissueRequest softer;
      softer.changes[&ContactProperties::stiffness_N_per_mm] = 0.9;
      softer.changes[&ContactProperties::static_friction] = 0.6;
      ASSERT_TRUE(host.set(softer).ok());
      softer.changes[&ContactProperties::stiffness_N_per_mm] = 0.8;
      ASSERT_TRUE(host.set(softer).ok());
      SettingsRequest stronger;
      stronger.max_force_N = 2.5;
      ASSERT_TRUE(host.set(stronger).ok());
      changed_at = call;
    }
    // a hand whose thread is delayed bounces on the surface
    if (changed_at >= 0 && turned_at < 0 && call >= changed_at + 25 && sent_N(tick) > 0.1) {
      turned_at = call;
      softened_N = sent_N(tick);
      reported = stiffnesses[0];
      SettingsRequest turn;
      turn.rotation_wxyz = {std::cos(0.05), 0, 0, std::sin(0.05)};
      turn.max_force_N = 1.0;
      ASSERT_TRUE(host.set(turn).ok());
      TissueRequest back;
      back.changes[&ContactProperties::stiffness_N_per_mm] = 1.5;
      ASSERT_TRUE(host.set(back).ok());
      SettingsRequest direct;
      direct.method = "b-spline";
      ASSERT_TRUE(host.set(direct).ok());
    }
    if (turned_at >= 0 && call == turned_at + 25) {
      SettingsRequest paused;
      paused.paused = true;
      ASSERT_TRUE(host.set(paused).ok());
    }
    if (turned_at >= 0 && call == turned_at + 35) stop_.store(true);
  });
  ASSERT_GE(changed_at, 0) << "the ball was never pressed";
  EXPECT_GT(softened_N, 0.1);
  EXPECT_EQ(reported, 0.8);
  EXPECT_EQ(result_->limit_N, 2.5) << "the highest that held";
  const auto changes = changes_in(recording);
  ASSERT_EQ(changes.size(), 3u);
  EXPECT_EQ(changes[1].contact.stiffness_N_per_mm, 0.8);
  EXPECT_EQ(changes[2].contact.static_friction, 0.6);
  expect_events_where_they_took_hold(recording);
  EXPECT_EQ(recording.ticks.back().model_version, 4u);
  EXPECT_EQ(recording.ticks.back().max_force_N, 1.0);
  EXPECT_TRUE(recording.ticks.back().switches & kSwitchPaused);
  EXPECT_NEAR(recording.ticks.back().rotation_target_wxyz[3], std::sin(0.05), 1e-12);
  expect_replays(recording);

  // an interrupted recording contains the changes, too
  Recording cut = recording;
  cut.summary.reset();
  auto again = replay(cut, loaded_.model);
  ASSERT_TRUE(again.ok()) << again.error().message();
  EXPECT_TRUE(again->identical) << again->difference;
  // missing changes, and changes that no scene permits, are reported
  Recording without = recording;
  without.events.clear();
  again = replay(without, loaded_.model);
  ASSERT_FALSE(again.ok());
  EXPECT_THAT(again.error().what, HasSubstr("of the model, which is missing from the file"));
  Recording wild = recording;
  first_change(wild).contact.stiffness_N_per_mm = 1e9;
  again = replay(wild, loaded_.model);
  ASSERT_FALSE(again.ok());
  EXPECT_EQ(again.error().where, "stiffness_N_per_mm");
  // and another value gives another run
  Recording other = recording;
  for (RecordingEvent& event : other.events)
    if (event.change.version == 3) event.change.contact.stiffness_N_per_mm = 0.85;
  again = replay(other, loaded_.model);
  ASSERT_TRUE(again.ok());
  EXPECT_FALSE(again->identical);
}

TEST_F(ViewedExplore, RebuiltFieldsReplay) {
  loaded_.model = std::make_shared<const Model>(testing::with_ramps(Model(*loaded_.model), 4));
  ExploreOptions options;
  options.seconds = 60;
  // on a busy machine a direct method occasionally loses contact; the script is repeated
  options.repeat = true;
  int softened_at = -1, contact_at = -1;
  const Recording recording = run(options, kPressAndHold, [&](LiveHost& host, int call) {
    std::array<double, kMaxDevices> stiffnesses{};
    const TickRecord tick = host.snapshot(stiffnesses);
    if (softened_at < 0 && sent_N(tick) > 0.5) {
      TissueRequest softer;
      softer.changes[&ContactProperties::stiffness_N_per_mm] = 0.9;
      ASSERT_TRUE(host.set(softer).ok());
      SettingsRequest direct;
      direct.method = "trilinear";
      ASSERT_TRUE(host.set(direct).ok());
      softened_at = call;
    }
    if (softened_at >= 0 && contact_at < 0 && tick.method == index_of(ForceMethod::kTrilinear))
      contact_at = call;
    // a hand whose thread is delayed bounces on the surface
    if (contact_at >= 0 && call >= contact_at + 30 && stiffnesses[0] != 0) {
      EXPECT_EQ(stiffnesses[0], 0.9);
      stop_.store(true);
    }
  });
  ASSERT_GE(contact_at, 0);
  EXPECT_TRUE(result_->stopped_by_user) << "nothing was felt then";
  const auto changes = changes_in(recording);
  ASSERT_EQ(changes.size(), 2u);
  EXPECT_EQ(changes[1].tissue, ModelChange::kFieldsRebuilt);
  EXPECT_EQ(recording.ticks.back().model_version, 3u);
  expect_replays(recording);
}

TEST_F(ViewedExplore, PointerRecoversAfterConnectionLoss) {
  ExploreOptions options;
  options.devices = {kPointer};
  options.seconds = 30;
  std::string observed;
  enum { kAbove, kPressing, kLost, kBack, kSteady, kDone } part = kAbove;
  int since = 0;
  // the patient's anterior is up: the ball from above, 1 mm deep
  const std::array<double, 3> above{0, -20, 0}, inside{0, -14, 0};
  LiveHost* host = nullptr;
  options.loop.realtime = false;
  options.viewers = [&](LiveHost& session) -> Result<std::shared_ptr<void>> {
    host = &session;
    return std::shared_ptr<void>();
  };
  options.request = [&] {
    if (since == 0) {
      EXPECT_EQ(host->scene().input, "pointer");
      // without control of the pointer nothing moves
      host->move_pointer(PointerTarget{inside});
      EXPECT_TRUE(host->claim_pointer(true, {5, true}).ok());
    }
    ++since;
    std::array<double, kMaxDevices> stiffness_N_per_mm{};
    const TickRecord tick = host->snapshot(stiffness_N_per_mm);
    const std::uint32_t flags = tick.device[0].flags;
    observed = "flags " + std::to_string(flags) + ", " + std::to_string(sent_N(tick)) + " N";
    if (part == kAbove) {
      host->move_pointer(PointerTarget{above});
      if ((flags & (kFlagStale | kFlagRamp)) == 0) part = kPressing;
    } else if (part == kPressing) {
      host->move_pointer(PointerTarget{inside});
      if (sent_N(tick) > 0.8) part = kLost;
    } else if (part == kLost) {
      if ((flags & kFlagStale) != 0 && sent_N(tick) == 0) part = kBack;
    } else if (part == kBack) {
      host->move_pointer(PointerTarget{inside});
      if (sent_N(tick) > 0.8) part = kSteady;
    } else if (part == kSteady) {
      // from a point above the surface, in steps of the regulated depth
      host->move_pointer(PointerTarget{{0, -15.5, 0}, {0, 1, 0}, 0.4});
      if (std::abs(sent_N(tick) - 0.4) < 0.02) part = kDone;
    } else {
      EXPECT_TRUE(host->claim_pointer(false, {5, true}).ok());
      if ((flags & kFlagStale) != 0 && sent_N(tick) == 0) stop_.store(true);
    }
    return ExploreRequest::kNone;
  };
  const auto file = folder_ / "run.h5";
  const auto result = explore(loaded_, Script{}, options, file, Progress({}, &stop_));
  ASSERT_TRUE(result.ok()) << result.error().message();
  EXPECT_EQ(part, kDone) << observed;
  EXPECT_TRUE(result->stopped_by_user);
  ASSERT_EQ(result->holds.size(), 1u);
  EXPECT_EQ(result->holds[0].structure, "ball");
  const auto recording = read_recording(file);
  ASSERT_TRUE(recording.ok()) << recording.error().message();
  EXPECT_EQ(recording->header.device, "pointer");
  EXPECT_FALSE(recording->header.simulated);
  EXPECT_EQ(recording->header.script_text, "");
  expect_replays(*recording);
  // pointer control and its times: released once, however often it is requested
  ASSERT_EQ(recording->events.size(), 2u);
  for (const RecordingEvent& event : recording->events) {
    EXPECT_EQ(event.kind, RecordingEvent::Kind::kSettings);
    EXPECT_EQ(event.changed, kSettingPointer);
    EXPECT_EQ(event.by, (RequestedBy{Originator::kControlViewer, 5}));
  }
  EXPECT_LT(recording->events[0].tick, recording->events[1].tick);
  // the displayed force has no steps while the pointer is held: 6 mm within an interval of at least 4 ms
  for (std::size_t t = 1; t < recording->ticks.size(); ++t) {
    const TickRecord &now = recording->ticks[t], &before = recording->ticks[t - 1];
    if (((now.device[0].flags | before.device[0].flags) & (kFaultFlags | kFlagStale)) != 0) continue;
    EXPECT_LE(std::abs(sent_N(now) - sent_N(before)), 2000 * now.dt_s + 1e-9) << now.tick;
    EXPECT_EQ(now.device[0].flags & kFlagJump, 0u);
  }
}

TEST_F(ViewedExplore, ViewerServerFailurePreventsTheSession) {
  ExploreOptions options;
  options.viewers = [](LiveHost&) -> Result<std::shared_ptr<void>> {
    return Error{ErrorKind::kUnavailable, "the port is taken", "--port", "choose another"};
  };
  const auto script = parse_script(kPressAndHold, "test script");
  const auto result = explore(loaded_, *script, options, folder_ / "run.h5");
  ASSERT_FALSE(result.ok());
  EXPECT_EQ(result.error().where, "--port");
  EXPECT_EQ(folder_.count(), 0u);
}

}  // namespace
}  // namespace palpate
