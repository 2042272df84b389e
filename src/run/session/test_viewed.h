#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <list>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "base/test_files.h"
#include "base/test_wait.h"
#include "loading/test_loading.h"
#include "palpate/base/clock.h"
#include "palpate/base/mailbox.h"
#include "palpate/base/reading.h"
#include "palpate/base/spsc_ring.h"
#include "palpate/device/model_change.h"
#include "palpate/direct/direct_methods.h"
#include "palpate/model/make_model.h"
#include "palpate/palpation/palpation.h"
#include "palpate/session/explore.h"
#include "session/live_session.h"

/// A ball with a shell in a running loop, seen by viewers.
namespace palpate::testing {

inline constexpr double kCartilage_mm = 3;
inline constexpr int kViewedBone = 0, kViewedCartilage = 1;

inline double sent_N(const TickRecord& tick) {
  const auto& f = tick.device[0].force_N;
  return Eigen::Vector3d(f[0], f[1], f[2]).norm();
}

/// Device whose tip follows the test's command regardless of any force.
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

/// The ball with its shell in a running loop, with a session.
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
    statistics_.emplace(*model_, std::vector<HoldRequest>{});
    live_->begin(*loop_, *statistics_);
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
  std::optional<SessionStatistics> statistics_;
};

}  // namespace palpate::testing
