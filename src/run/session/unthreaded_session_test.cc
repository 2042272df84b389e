#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <list>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <utility>
#include <vector>

#include "contact/test_model.h"
#include "palpate/base/check.h"
#include "palpate/base/spsc_ring.h"
#include "palpate/model/changed_model.h"
#include "palpate/palpation/palpation.h"
#include "servo/test_guided_burr.h"
#include "session/live_session.h"

/// A session whose owner runs its ticks, and solves and removes tissue between them, as a browser's worker
/// does.
namespace palpate {
namespace {

using SessionClock = std::chrono::steady_clock;

std::int64_t tick_time_ns = 0;
std::int64_t tick_time() noexcept {
  return tick_time_ns;
}

// gives a number of ticks, 1 ms apart
class TicksOfMilliseconds final : public ServoClock {
 public:
  explicit TicksOfMilliseconds(int left) : left_(left) {}
  bool wait() noexcept override {
    if (left_-- == 0) return false;
    tick_time_ns += 1'000'000;
    return true;
  }
  bool stopped() const noexcept override { return false; }

 private:
  int left_;
};

// device whose tip moves along z at 50 mm/s
class DescendingDriver final : public DeviceDriver {
 public:
  explicit DescendingDriver(double z_mm) : z_mm_(z_mm), to_z_mm_(z_mm) {
    info_.name = "descending";
    info_.simulated = true;
  }
  void descend_to(double z_mm) { to_z_mm_ = z_mm; }
  std::span<const DeviceInfo> devices() const override { return {&info_, 1}; }
  Result<void> open(bool) override { return {}; }
  void run(ServoFunction& servo, ServoClock& clock) noexcept override {
    std::array<DeviceSample, 1> samples;
    std::array<DeviceCommand, 1> commands{};
    while (clock.wait()) {
      z_mm_ += std::clamp(to_z_mm_ - z_mm_, -0.05, 0.05);
      samples[0].tip = Point<Device>(0, 0, z_mm_);
      samples[0].taken_ns = tick_time_ns;
      servo.update(samples, commands);
    }
  }
  void halt() noexcept override {}
  void resume(std::uint64_t /*newest*/) noexcept override {}

 private:
  DeviceInfo info_;
  double z_mm_, to_z_mm_;
};

class UnthreadedSession : public ::testing::Test {
 protected:
  void start(std::shared_ptr<const Model> model, double from_z_mm) {
    tick_time_ns = 1'000'000;
    model_ = std::move(model);
    driver_.emplace(from_z_mm);
    Parameters parameters;
    parameters.method = ForceMethod::kProxy;
    LiveSessionParts parts;
    parts.model = model_;
    parts.devices = {driver_->devices()[0]};
    parts.parameters = parameters;
    parts.input = "device";
    parts.threads = false;
    live_.emplace(std::move(parts));
    auto loop =
        ServoLoop::make_unthreaded(model_, *driver_, parameters, {WorkspaceSettings{}}, {}, tick_time);
    ASSERT_TRUE(loop.ok()) << loop.error().message();
    loop_ = *std::move(loop);
    watch_.emplace(*model_, std::vector<HoldRequest>{});
    live_->begin(*loop_, *watch_);
    now_ = SessionClock::now();
  }
  // four ticks, then at most `steps` steps that are due
  void advance(int steps) {
    TicksOfMilliseconds four(4);
    loop_->run(four);
    std::array<TickRecord, 8> some;
    const auto taken = std::span(some).first(loop_->ring().pop(some));
    recording_.ticks.insert(recording_.ticks.end(), taken.begin(), taken.end());
    now_ += std::chrono::milliseconds(4);
    bool is_more_due = true;
    for (int n = 0; n < steps && is_more_due; ++n) {
      is_more_due = live_->run_step(now_);
      ++steps_;
    }
  }
  TickRecord latest() const { return loop_->snapshot(); }
  void set_motor(bool on) {
    SettingsRequest request;
    request.motor = on;
    ASSERT_TRUE(live_->set(request).ok());
  }
  void expect_identical_replay() {
    std::list<RecordingEvent> events;
    live_->log().take(events);
    recording_.events.assign(events.begin(), events.end());
    recording_.header.model_hash = model_->content_hash;
    recording_.header.model_version = model_->version;
    recording_.header.tissue_cell_factor = model_->tissue_cell_factor;
    const auto replayed = replay(recording_, model_);
    ASSERT_TRUE(replayed.ok()) << replayed.error().message();
    EXPECT_TRUE(replayed->identical) << replayed->difference;
  }

  std::shared_ptr<const Model> model_;
  std::optional<DescendingDriver> driver_;
  std::optional<LiveSession> live_;
  std::unique_ptr<ServoLoop> loop_;
  std::optional<SessionStatistics> watch_;
  SessionClock::time_point now_;
  int steps_ = 0;
  Recording recording_;
};

constexpr double kShell_mm = 3, kOuterRadius_mm = testing::kBoneRadius_mm + kShell_mm;

// a ball of bone in a shell of soft tissue, which is solved in coarser cells than requested
std::shared_ptr<const Model> soft_shell() {
  Model model = testing::with_exact_surfaces(testing::ball_model({1, 1, 1}, 1.0, kShell_mm), kShell_mm);
  model.tissues[1].elastic = ElasticConstants{60, 0.45};
  model.tissue_cell_mm = 1.5;
  auto under = under_law(model, TissueLaw::kElastic);
  PALPATE_CHECK(under.ok());
  model = **under;
  model.tissue_cell_factor = 2;
  return std::make_shared<const Model>(std::move(model));
}

TEST_F(UnthreadedSession, SolvesTissueInStepsBetweenTicks) {
  start(soft_shell(), kOuterRadius_mm + 3);
  driver_->descend_to(kOuterRadius_mm - 1);
  for (int n = 0; n < 60; ++n) advance(1000);
  EXPECT_GE(latest().solver_frame, 12u) << "a frame is due every 15.6 ms";
  EXPECT_LE(latest().solver_frame, 17u);
  EXPECT_GT(steps_, 60 + 2 * static_cast<int>(latest().solver_frame)) << "a frame takes several steps";
  EXPECT_GT(latest().device[0].contact_N[0], 0.01);
  ASSERT_NE(live_->deformation(0), nullptr);
  const ViewedState state = live_->state();
  EXPECT_EQ(state.law, "elastic");
  EXPECT_EQ(state.law_cell_mm, 3);
  EXPECT_EQ(state.requested_cell_mm, 1.5);
  expect_identical_replay();
}

// a frame that spans many ticks is used as soon as it is complete, and the next one begins from the latest
// tick
TEST_F(UnthreadedSession, SlowSolverProducesFewerFramesOnOlderTicks) {
  start(soft_shell(), kOuterRadius_mm + 3);
  driver_->descend_to(kOuterRadius_mm - 1);
  for (int n = 0; n < 150; ++n) advance(1);
  EXPECT_GE(latest().solver_frame, 10u);
  EXPECT_LE(latest().solver_frame, 150u / 4) << "one step of a frame in four ticks";
  std::set<std::uint32_t> frames;
  for (const TickRecord& tick : recording_.ticks) frames.insert(tick.solver_frame);
  EXPECT_EQ(frames.size(), latest().solver_frame + 1u) << "every frame is used";
  EXPECT_GT(latest().device[0].contact_N[0], 0.01);
  expect_identical_replay();
}

TEST_F(UnthreadedSession, RemovesAndRestoresWhatTheBurrSweeps) {
  start(std::make_shared<const Model>(testing::burr_model()), testing::kBoneRadius_mm + 6);
  driver_->descend_to(testing::kBoneRadius_mm - 1);
  for (int n = 0; n < 130; ++n) advance(1);
  EXPECT_EQ(live_->state().sweeps, 0u) << "the motor is off";
  set_motor(true);
  for (int n = 0; n < 50; ++n) advance(1);
  set_motor(false);
  for (int n = 0; n < 10; ++n) advance(1);
  ViewedState state = live_->state();
  EXPECT_GT(state.sweeps, 0u);
  ASSERT_FALSE(state.removed_mm3.empty());
  EXPECT_GT(state.removed_mm3.begin()->second, 0.1);
  EXPECT_EQ(latest().model_version, state.model_version);
  EXPECT_NE(live_->labels(), model_->labels);
  EXPECT_EQ(state.strokes_to_undo, 1u);

  ASSERT_TRUE(live_->set(StrokeRequest{StrokeAction::kUndo, {}, 0}).ok());
  for (int n = 0; n < 4; ++n) advance(1);
  state = live_->state();
  EXPECT_EQ(state.strokes_to_undo, 0u);
  EXPECT_EQ(state.sweeps, 0u);
  expect_identical_replay();
}

TEST_F(UnthreadedSession, MakesNoStepAfterItIsClosed) {
  start(soft_shell(), kOuterRadius_mm + 3);
  for (int n = 0; n < 10; ++n) advance(1);
  live_->close();
  EXPECT_FALSE(live_->run_step(now_ + std::chrono::seconds(1)));
  EXPECT_EQ(live_->deformation(0), nullptr);
}

}  // namespace
}  // namespace palpate
