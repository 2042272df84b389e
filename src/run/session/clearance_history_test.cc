#include "session/clearance_history.h"

#include <gtest/gtest.h>

#include <span>
#include <vector>

#include "loading/test_loading.h"
#include "palpate/recording/recording.h"

namespace palpate {
namespace {

TEST(ClearanceHistory, IsTheSameHoweverARecordingComesInParts) {
  Model model = *testing::loaded_burr().model;
  for (Tissue& tissue : model.tissues) tissue.protection = Protection::kAlarm;
  constexpr ForceMethod kProxyAlone[] = {ForceMethod::kProxy};
  const auto ready = prepared_with_cache(std::make_shared<const Model>(std::move(model)), kProxyAlone);
  ASSERT_TRUE(ready.ok());
  ASSERT_FALSE((*ready)->protected_structures.empty());
  const Point<Patient> centre = (*ready)->labels->geometry().centre();

  // the motor is off: distances come from the sweeps alone
  std::vector<TickRecord> ticks(20);
  for (std::size_t n = 0; n < ticks.size(); ++n) {
    ticks[n].tick = n;
    ticks[n].time_s = 1e-3 * static_cast<double>(n);
  }
  std::vector<RecordingEvent> events;
  for (const auto& [tick, away_mm] : {std::pair{5, 19.5}, {5, 19.0}, {9, 18.0}, {17, 10.0}}) {
    RecordingEvent& event = events.emplace_back();
    event.kind = RecordingEvent::Kind::kSweep;
    event.tick = static_cast<std::uint64_t>(tick);
    const std::array<double, 3> at{centre.x() + away_mm, centre.y(), centre.z()};
    event.sweep = {0, at, at, 2, 1};
  }

  const std::span<const TickRecord> all(ticks);
  const std::span<const RecordingEvent> recorded_events(events);
  ClearanceHistory whole(**ready), before(**ready), apart(**ready);
  whole.observe(all, recorded_events);
  // all events first, in a part without ticks
  before.observe({}, recorded_events);
  before.observe(all, {});
  // split within parts; some events precede their ticks
  apart.observe(all.first(4), recorded_events.first(3));
  apart.observe(all.subspan(4, 3), {});
  apart.observe({}, recorded_events.subspan(3));
  apart.observe(all.subspan(7), {});

  EXPECT_TRUE(whole.at(0.0045).empty());
  ASSERT_EQ(whole.at(0.005).size(), 1u);
  EXPECT_NEAR(whole.at(0.005).begin()->second, 2, 0.2);
  EXPECT_NEAR(whole.at(0.012).begin()->second, 1, 0.2);
  EXPECT_EQ(whole.at(0.019).begin()->second, 0);
  for (double time_s = 0; time_s < 0.02; time_s += 0.0005) {
    EXPECT_EQ(before.at(time_s), whole.at(time_s)) << time_s;
    EXPECT_EQ(apart.at(time_s), whole.at(time_s)) << time_s;
  }
}

}  // namespace
}  // namespace palpate
