#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <thread>

#include "session/test_viewed.h"

namespace palpate {
namespace {

using ::testing::HasSubstr;
using testing::kViewedCartilage;
using testing::sent_N;
using testing::soon;
using testing::Viewed;

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

TEST_F(Viewed, RearmIsRefusedWhileInContact) {
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

TEST_F(Viewed, BeforeTheLoopStartsStateIsReadableAndRequestsAreRefused) {
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

}  // namespace
}  // namespace palpate
