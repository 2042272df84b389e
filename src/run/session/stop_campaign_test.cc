// Random sequences of stops, rearms, pauses, faults, and viewers connecting and disconnecting, on a simulated
// clock. Invariant: a stop request never does anything but stop.
#include <gtest/gtest.h>

#include <cstdlib>
#include <random>

#include "base/test_seed.h"
#include "contact/test_model.h"
#include "palpate/base/spsc_ring.h"
#include "servo/test_loop.h"
#include "session/live_session.h"

namespace palpate {
namespace {

constexpr std::int64_t kCampaignPeriod_ns = 4'000'000;
constexpr double kFree_mm = testing::kBoneRadius_mm + 6;
std::int64_t campaign_ns = 0;
std::int64_t campaign_clock() noexcept {
  return campaign_ns;
}

class NoDriver final : public DeviceDriver {
 public:
  explicit NoDriver(bool simulated) {
    info_.name = "none";
    info_.simulated = simulated;
    info_.peak_force_N = 8;
  }
  std::span<const DeviceInfo> devices() const override { return {&info_, 1}; }
  Result<void> open(bool) override { return {}; }
  void run(ServoFunction&, ServoClock&) noexcept override {}
  void halt() noexcept override {}
  void resume(std::uint64_t /*newest*/) noexcept override {}

 private:
  DeviceInfo info_;
};

std::shared_ptr<const Model> campaign_model() {
  Model model = testing::with_exact_surfaces(testing::ball_model({2, 2, 2}));
  model.content_hash = 42;
  return std::make_shared<const Model>(std::move(model));
}

Parameters campaign_parameters() {
  Parameters parameters;
  parameters.method = ForceMethod::kProxy;
  return parameters;
}

// a viewer and its last observation of the session
struct Onlooker {
  ViewerIdentity identity;
  std::uint32_t observed_stop = 0;
};

/// Session whose ticks the test calls.
class CampaignSession {
 public:
  CampaignSession(std::shared_ptr<const Model> model, bool simulated, std::mt19937_64& random)
      : model_(std::move(model)),
        physical_(!simulated),
        random_(random),
        driver_(simulated),
        loop_(model_, driver_, campaign_parameters(), {WorkspaceSettings{}},
              {.rate_hz = 250, .realtime = false, .ring_s = 8}, campaign_clock),
        live_(LiveSessionParts{model_,
                               {driver_.devices().begin(), driver_.devices().end()},
                               {},
                               loop_.parameters(),
                               "device",
                               250,
                               nullptr,
                               false,
                               Modality::kMr,
                               true}),
        statistics_(*model_, {}) {
    live_.begin(loop_, statistics_);
    viewers_.push_back({{1, true}});
    for (int n = 0; n < 150; ++n) tick();
  }
  ~CampaignSession() { live_.end(); }

  void act();
  void tick();
  void replay_it();

  int stops = 0, rearms = 0, rearmed = 0, pushed = 0, requested = 0, agreed = 0;

 private:
  int below(int n) { return static_cast<int>(random_() % static_cast<unsigned>(n)); }
  Onlooker& somebody() {
    return viewers_[static_cast<std::size_t>(below(static_cast<int>(viewers_.size())))];
  }
  bool free() const { return (loop_.snapshot().device[0].flags & (kFlagContact | kFlagInside)) == 0; }
  void stop();
  void rearm();
  void change();
  void connect_or_disconnect();

  std::shared_ptr<const Model> model_;
  const bool physical_;
  std::mt19937_64& random_;
  NoDriver driver_;
  Loop loop_;
  LiveSession live_;
  SessionStatistics statistics_;

  std::vector<Onlooker> viewers_;
  std::uint32_t greeted_ = 1, shown_ = 0;
  std::uint64_t question_ = 0;
  double height_mm_ = kFree_mm, wanted_mm_ = testing::kBoneRadius_mm - 0.7;
  int failure_ = 0, troubled_ticks_ = 0;
  bool stopped_ = false;  // expected state, from the requests that were granted
};

void CampaignSession::tick() {
  campaign_ns += kCampaignPeriod_ns;
  height_mm_ += std::clamp(wanted_mm_ - height_mm_, -0.5, 0.5);
  DeviceSample sample;
  sample.tip = Point<Device>(height_mm_, 0, 0);
  sample.taken_ns = campaign_ns;
  if (troubled_ticks_ > 0 && troubled_ticks_-- > 0) {
    if (failure_ == 0) sample.fault = true;
    if (failure_ == 1) sample.taken_ns -= 30'000'000;
    if (failure_ == 2) sample.tip = Point<Device>(std::nan(""), 0, 0);
    if (failure_ == 3) campaign_ns += kStall_ns + 1;
    if (failure_ == 4) sample.tip = Point<Device>(height_mm_, 90, 0);
  }
  DeviceCommand command;
  loop_.update({&sample, 1}, {&command, 1});
  const double force_N = command.force_N.norm();
  if (stopped_) {
    ASSERT_EQ(force_N, 0) << "stopped, and nobody who had seen it rearmed";
    ASSERT_TRUE(loop_.snapshot().switches & kSwitchEmergencyStop);
  }
  pushed += force_N > 0.1;
}

void CampaignSession::stop() {
  ++stops;
  if (below(2) == 0)
    live_.stop_by_key();
  else
    live_.emergency_stop(somebody().identity);
  stopped_ = true;
}

// answers the stop observed last, which may be outdated, a random one, or the current one
void CampaignSession::rearm() {
  ++rearms;
  Onlooker& who = somebody();
  const std::uint32_t holds = live_.state().stop.value_or(0);
  const bool here = below(2) == 0;
  const std::uint32_t names = below(4) == 0   ? static_cast<std::uint32_t>(below(40))
                              : below(2) == 0 ? holds
                              : here          ? shown_
                                              : who.observed_stop;
  const bool was_free = free();
  const bool done = here ? live_.rearm_by_key(names).ok() : live_.rearm({names, who.identity}).ok();
  if (!done) return;
  ++rearmed;
  EXPECT_TRUE(was_free);
  EXPECT_TRUE(here || !physical_);
  EXPECT_EQ(names, holds);
  stopped_ = false;
}

void CampaignSession::change() {
  SettingsRequest request;
  request.by = somebody().identity;
  request.id = below(1000);
  if (below(2) == 0) request.paused = below(2) == 0;
  if (below(2) == 0) request.max_force_N = 0.5 + 0.1 * below(20);
  if (below(2) == 0) request.friction = below(2) == 0;
  if (below(3) == 0) request.method = below(2) == 0 ? "proxy" : "trilinear";
  const double angle = 0.1 * below(9) - 0.4;
  request.rotation_wxyz = {std::cos(angle), 0, 0, std::sin(angle)};
  const Parameters before = loop_.parameters();
  const auto granted = live_.set(request);
  if (!granted || *granted == RequestOutcome::kDone) return;
  ++requested;
  EXPECT_TRUE(physical_);
  const Parameters after = loop_.parameters();
  EXPECT_EQ(after.rotation_target.coeffs(), before.rotation_target.coeffs());
  EXPECT_EQ(after.paused, before.paused);
  EXPECT_EQ(after.max_force_N, before.max_force_N);
}

void CampaignSession::connect_or_disconnect() {
  if (viewers_.size() > 1 && below(2) == 0) {
    live_.forget(viewers_.back().identity);
    viewers_.pop_back();
    return;
  }
  if (viewers_.size() < 5) viewers_.push_back({{++greeted_, below(3) != 0}});
  viewers_.back().observed_stop = live_.state().stop.value_or(0);
}

void CampaignSession::act() {
  switch (below(12)) {
    case 0:
    case 1:
      return stop();
    case 2:
    case 3:
    case 4:
      return rearm();
    case 5:
      return live_.pause_by_key();
    case 6:
      failure_ = below(5);
      troubled_ticks_ = 1 + below(3);
      return;
    case 7:
      return connect_or_disconnect();
    case 8:
      return change();
    case 9:
      somebody().observed_stop = live_.state().stop.value_or(0);
      shown_ = live_.current_stop().value_or(0);
      question_ = live_.question().value_or(ConsentQuestion{}).number;
      return;
    case 10: {
      const auto before = live_.read_answers().size();
      live_.answer_by_key(question_, below(2) == 0);
      for (const LateAnswer& late : live_.read_answers()) agreed += late.outcome.ok() && before == 0;
      return;
    }
    default:
      wanted_mm_ = below(2) == 0 ? kFree_mm : testing::kBoneRadius_mm - 0.1 * below(10);
      // a few ticks of approach
      for (int n = below(20); n > 0; --n) tick();
  }
}

// replays every tick from what a recording would contain
void CampaignSession::replay_it() {
  Recording recording;
  recording.header.model_hash = model_->content_hash;
  recording.ticks.resize(loop_.ring().size());
  recording.ticks.resize(loop_.ring().pop(std::span(recording.ticks)));
  ASSERT_EQ(loop_.health().dropped, 0u);
  const auto again = replay(recording, model_);
  ASSERT_TRUE(again.ok()) << again.error().message();
  EXPECT_TRUE(again->identical) << again->difference;
  EXPECT_EQ(again->ticks, recording.ticks.size());
}

TEST(StopCampaign, AStopNeverRaisesForceAndTheNextTickSendsNone) {
  // the full campaign is PALPATE_TEST_STOPS=10000
  const char* sequence_count = std::getenv("PALPATE_TEST_STOPS");
  const int sequences = sequence_count != nullptr ? std::atoi(sequence_count) : 1000;
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("PALPATE_TEST_SEED=" + std::to_string(seed));
  std::mt19937_64 random(seed);
  const auto model = campaign_model();
  int stops = 0, rearms = 0, rearmed = 0, pushed = 0, requested = 0, agreed = 0;
  for (int sequence = 0; sequence < sequences; ++sequence) {
    SCOPED_TRACE("sequence " + std::to_string(sequence));
    campaign_ns = 1'000'000'000;
    CampaignSession session(model, sequence % 2 == 0, random);
    for (int n = 0; n < 60; ++n) {
      session.act();
      for (auto ticks = random() % 3; ticks > 0; --ticks) session.tick();
      if (::testing::Test::HasFailure()) return;
    }
    if (sequence % 10 == 0) session.replay_it();
    stops += session.stops;
    rearms += session.rearms;
    rearmed += session.rearmed;
    pushed += session.pushed;
    requested += session.requested;
    agreed += session.agreed;
  }
  std::printf(
      "%d sequences: %d stops, %d of %d rearms done, %d ticks with a force; %d asked for, %d agreed to\n",
      sequences, stops, rearmed, rearms, pushed, requested, agreed);
  EXPECT_GT(rearmed, sequences / 4);
  EXPECT_GT(pushed, sequences);
  EXPECT_GT(requested, 0);
  EXPECT_GT(agreed, 0);
}

}  // namespace
}  // namespace palpate
