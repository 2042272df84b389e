#include "report/contacts.h"
#include "palpate/recording/recording_source.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <span>

namespace palpate::report {
namespace {

/// Calls `observe` for every tick of a recording with its times.
template <class OnTick>
void relink_unpaired(const Recording& recording, OnTick&& observe) {
  TickTimes times(RecordingSource(recording).head());
  // in chunks, as when reading
  for (std::size_t first = 0; first < recording.ticks.size(); first += 37)
    times.take(
        std::span(recording.ticks).subspan(first, std::min<std::size_t>(37, recording.ticks.size() - first)),
        observe);
  times.finish(observe);
}

int devices_of(const Recording& recording) {
  return device_count(RecordingSource(recording).head());
}

std::vector<StructureFigures> summarise_structures(const Recording& recording, const Model& model,
                                                   const std::vector<Contact>& contacts) {
  StructureMeter meter(devices_of(recording), model);
  relink_unpaired(recording, [&](const TimedTick& now) { meter.observe(now); });
  return meter.finish(contacts);
}

RecordingSummary summary_of(const Recording& recording) {
  SummaryMeter meter;
  for (const TickRecord& tick : recording.ticks) meter.observe(tick);
  return meter.finish(RecordingSource(recording).head());
}

std::uint64_t count_ticks_with(const Recording& recording, std::uint32_t flags) {
  TickCount count{flags, 0};
  for (const TickRecord& tick : recording.ticks) count.observe(tick, devices_of(recording));
  return count.ticks;
}

ForceExtremes force_extremes(const Recording& recording) {
  ForceExtremes extremes;
  for (const TickRecord& tick : recording.ticks) extremes.observe(tick, devices_of(recording));
  return extremes;
}

/// Start of each tick, and the end of the last one.
std::vector<double> tick_edges_s(const Recording& recording) {
  std::vector<double> edges{0};
  relink_unpaired(recording, [&](const TimedTick& now) {
    EXPECT_EQ(now.index + 1, edges.size());
    edges.back() = now.begin_s;
    edges.push_back(now.end_s);
  });
  return edges;
}

/// A run at 1 kHz with one device.
struct Script {
  Recording recording;
  void ticks(int count, LabelId label, double force_N = 0, double depth_mm = 0, double speed_mm_s = 0) {
    for (int i = 0; i < count; ++i) {
      TickRecord tick;
      tick.tick = recording.ticks.size();
      tick.time_s = 1e-3 * static_cast<double>(tick.tick);
      tick.max_force_N = 3;
      tick.device[0].limit_N = 3;
      tick.device[0].label = label;
      if (label != 0) tick.device[0].flags = kFlagContact;
      tick.device[0].force_N = {0.6 * force_N, 0, 0.8 * force_N};
      tick.device[0].depth_mm = depth_mm;
      tick.device[0].velocity_patient_mm_s = {0, speed_mm_s, 0};
      recording.ticks.push_back(tick);
    }
  }
  std::vector<double> edges() const { return tick_edges_s(recording); }
  std::vector<Contact> contacts() const {
    ContactFinder finder(devices_of(recording));
    relink_unpaired(recording, [&](const TimedTick& now) { finder.observe(now); });
    return finder.finish();
  }
};

TEST(Contacts, AreUnbrokenAndOfOneStructure) {
  Script run;
  run.ticks(100, 0);
  run.ticks(80, 5, 1);
  run.ticks(70, 6, 1);  // directly on to another structure
  run.ticks(1, 0);      // one tick without contact
  run.ticks(60, 6, 1);
  const auto contacts = run.contacts();
  ASSERT_EQ(contacts.size(), 3u);
  EXPECT_EQ(contacts[0].label, 5);
  EXPECT_EQ(contacts[0].first, 100u);
  EXPECT_EQ(contacts[0].last, 179u);
  EXPECT_NEAR(contacts[0].duration_s(), 0.080, 1e-12);
  EXPECT_EQ(contacts[1].first, 180u);
  EXPECT_EQ(contacts[1].last, 249u);
  // the last contact extends to the end of the run
  EXPECT_EQ(contacts[2].label, 6);
  EXPECT_EQ(contacts[2].last, run.recording.ticks.size() - 1);
  EXPECT_NEAR(contacts[2].duration_s(), 0.060, 1e-12);
}

TEST(Contacts, LastFiftyMillisecondsAtLeast) {
  Script run;
  run.ticks(49, 5, 1);
  run.ticks(10, 0);
  run.ticks(50, 7, 1);
  const auto contacts = run.contacts();
  ASSERT_EQ(contacts.size(), 1u);
  EXPECT_EQ(contacts[0].label, 7);
}

TEST(Contacts, LabelWithoutContactDoesNotCount) {
  Script run;
  run.ticks(200, 5, 1);
  for (TickRecord& tick : run.recording.ticks) tick.device[0].flags = 0;
  EXPECT_TRUE(run.contacts().empty());
  EXPECT_TRUE(summarise_structures(run.recording, Model{}, {}).empty());
}

TEST(Contacts, CountsForcesOfDeeperStructuresSeparately) {
  Script run;
  run.ticks(100, 5, 2);
  run.ticks(50, 6, 2);
  for (std::size_t n = 0; n < run.recording.ticks.size(); ++n) {
    DeviceTick& device = run.recording.ticks[n].device[0];
    device.path_label = {5, 6};
    device.path_depth_mm = {1, 0.01 * static_cast<double>(n)};
    device.path_share = {0.25, 0.75};
  }
  // a damaged file
  run.recording.ticks[10].device[0].path_share[1] = kNoValue;
  run.recording.ticks[11].device[0].path_depth_mm[1] = kNoValue;
  BeneathMeter meter(1);
  relink_unpaired(run.recording, [&](const TimedTick& now) { meter.observe(now); });
  const std::vector<DeepFigures> figures = meter.finish();
  ASSERT_EQ(figures.size(), 2u);
  EXPECT_EQ(figures[0].label, 6);
  EXPECT_NEAR(figures[0].time_s, 0.099, 1e-9);
  EXPECT_NEAR(figures[0].peak_force_N, 1.5, 1e-12);
  EXPECT_NEAR(figures[0].max_depth_mm, 0.99, 1e-12);
  EXPECT_EQ(figures[1].label, 5);
  EXPECT_NEAR(figures[1].time_s, 0.050, 1e-9);
  EXPECT_NEAR(figures[1].peak_force_N, 0.5, 1e-12);
}

TEST(Contacts, PeakIsTheFirstTickWithTheLargestForce) {
  Script run;
  run.ticks(60, 5, 1);
  run.ticks(20, 5, 2.5);
  run.ticks(60, 5, 2);
  ASSERT_EQ(run.contacts().size(), 1u);
  EXPECT_EQ(run.contacts()[0].peak, 60u);
}

TEST(Contacts, EachDeviceHasItsOwn) {
  Script run;
  run.ticks(300, 0);
  run.recording.header.devices = 2;
  for (int i = 0; i < 200; ++i) {
    run.recording.ticks[50 + i].device[0].label = 4;
    run.recording.ticks[50 + i].device[0].flags = kFlagContact;
    run.recording.ticks[20 + i].device[1].label = 9;
    run.recording.ticks[20 + i].device[1].flags = kFlagContact;
    run.recording.ticks[20 + i].device[2].label = 3;  // the third device does not exist
    run.recording.ticks[20 + i].device[2].flags = kFlagContact;
  }
  const auto contacts = run.contacts();
  ASSERT_EQ(contacts.size(), 2u);
  EXPECT_EQ(contacts[0].device, 1);
  EXPECT_EQ(contacts[0].label, 9);
  EXPECT_EQ(contacts[1].device, 0);
  EXPECT_EQ(contacts[1].label, 4);
}

// against a slow reference: for every tick, the extent of its contact in both directions
TEST(Contacts, AgreeWithTheDefinitionOnRandomRuns) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    std::mt19937 random(seed);
    Script run;
    for (int i = 0; i < 40; ++i) {
      run.ticks(1 + static_cast<int>(random() % 90), static_cast<LabelId>(random() % 4), 1);
    }
    const auto& ticks = run.recording.ticks;
    std::vector<bool> expected(ticks.size()), found(ticks.size());
    for (std::size_t i = 0; i < ticks.size(); ++i) {
      std::size_t first = i, last = i;
      while (first > 0 && ticks[first - 1].device[0].label == ticks[i].device[0].label) --first;
      while (last + 1 < ticks.size() && ticks[last + 1].device[0].label == ticks[i].device[0].label) ++last;
      expected[i] = ticks[i].device[0].label != 0 && last - first + 1 >= 50;
    }
    for (const Contact& contact : run.contacts()) {
      for (std::size_t i = contact.first; i <= contact.last; ++i) {
        EXPECT_FALSE(found[i]);
        EXPECT_EQ(ticks[i].device[0].label, contact.label);
        found[i] = true;
      }
    }
    EXPECT_EQ(found, expected);
  }
}

TEST(Structures, FiguresAreOverTimeAndCountBriefTouches) {
  Script run;
  run.ticks(100, 5, 1.0, 0.2, 10);
  run.ticks(10, 0, 0, 0, 400);
  run.ticks(20, 5, 3.0, 0.9, 4);   // brief
  run.ticks(10, 8, 0.5, -0.4, 1);  // brief, the only one, and outside the surface
  const auto figures = summarise_structures(run.recording, Model{}, run.contacts());
  ASSERT_EQ(figures.size(), 2u);
  EXPECT_EQ(figures[0].label, 5);
  EXPECT_EQ(figures[0].contacts, 1);
  EXPECT_NEAR(figures[0].contact_s, 0.120, 1e-12);
  EXPECT_NEAR(figures[0].mean_force_N, (100 * 1.0 + 20 * 3.0) / 120, 1e-12);
  EXPECT_NEAR(figures[0].peak_force_N, 3.0, 1e-12);
  EXPECT_EQ(figures[0].max_depth_mm, 0.9);
  EXPECT_NEAR(figures[0].mean_speed_mm_s, (100 * 10.0 + 20 * 4.0) / 120, 1e-12);
  EXPECT_EQ(figures[1].label, 8);
  EXPECT_EQ(figures[1].contacts, 0);
  EXPECT_EQ(figures[1].max_depth_mm, -0.4);
}

TEST(Structures, DepthOutOfReachIsNoNumber) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  Script run;
  run.ticks(60, 5, 1.0, 0.2);
  run.ticks(60, 5, 2.0, kNan);
  run.ticks(60, 6, 2.0, kNan);
  run.ticks(60, 7, 2.0, 0.4);
  run.ticks(60, 0, 0.0, kNan);  // no contact
  const auto figures = summarise_structures(run.recording, Model{}, run.contacts());
  ASSERT_EQ(figures.size(), 3u);
  EXPECT_EQ(figures[0].max_depth_mm, 0.2);
  EXPECT_TRUE(figures[0].deeper_than_measured);
  EXPECT_TRUE(std::isnan(figures[1].max_depth_mm));
  EXPECT_TRUE(figures[1].deeper_than_measured);
  EXPECT_EQ(figures[2].max_depth_mm, 0.4);
  EXPECT_FALSE(figures[2].deeper_than_measured);
}

TEST(Structures, TheFieldTellsDeepInsideFromInFront) {
  Script run;
  run.ticks(60, 2, 1.0, 0.2);
  run.ticks(1, 2, 1.0, std::numeric_limits<double>::quiet_NaN());
  Model model;
  model.level_of_label = {0, 0, 0.8F};
  DeviceTick& device = run.recording.ticks.back().device[0];
  const auto deeper = [&](double field) {
    device.field = field;
    EXPECT_EQ(is_deeper_than_measured(device, model), field >= 0.4);
    const auto figures = summarise_structures(run.recording, model, run.contacts());
    EXPECT_TRUE(figures[0].depth_has_gaps);
    EXPECT_EQ(figures[0].max_depth_mm, 0.2);
    EXPECT_FALSE(figures[0].in_front);
    return figures[0].deeper_than_measured;
  };
  EXPECT_FALSE(deeper(0.01));
  EXPECT_FALSE(deeper(0.39));
  EXPECT_TRUE(deeper(0.41));
  device.depth_mm = 3;
  EXPECT_FALSE(is_deeper_than_measured(device, model));
}

TEST(Structures, BelowHalfASecondInAllIsInPassing) {
  Script run;
  run.ticks(250, 1, 1);
  run.ticks(5, 0);
  run.ticks(250, 1, 1);
  run.ticks(499, 2, 1);
  const auto figures = summarise_structures(run.recording, Model{}, run.contacts());
  ASSERT_EQ(figures.size(), 2u);
  EXPECT_FALSE(figures[0].in_passing());
  EXPECT_TRUE(figures[1].in_passing());
}

TEST(MainContacts, AreTheLongestOfTheStructuresTouchedLongest) {
  Script run;
  run.ticks(60, 1, 1);
  run.ticks(5, 0);
  run.ticks(90, 1, 1);  // the longer contact of structure 1
  run.ticks(5, 0);
  run.ticks(70, 2, 1);
  run.ticks(5, 0);
  run.ticks(300, 3, 1);
  const auto contacts = run.contacts();
  const auto figures = summarise_structures(run.recording, Model{}, contacts);
  const auto all = main_contacts(contacts, figures, 8);
  ASSERT_EQ(all.size(), 3u);
  EXPECT_EQ(all[0].label, 1);
  EXPECT_EQ(all[0].first, 65u);
  EXPECT_EQ(all[1].label, 2);
  EXPECT_EQ(all[2].label, 3);
  // structure 2 has the shortest contact
  const auto two = main_contacts(contacts, figures, 2);
  ASSERT_EQ(two.size(), 2u);
  EXPECT_EQ(two[0].label, 1);
  EXPECT_EQ(two[1].label, 3);
}

TEST(Safety, CutShortRunsAreCounted) {
  Script run;
  run.ticks(10, 0);
  run.recording.ticks[1].device[0].flags = kFlagClamped | kFlagContact;
  run.recording.ticks[2].device[0].flags = kFlagClamped | kFlagOutside;
  run.recording.ticks[3].device[0].flags = kFlagNotFinite;
  run.recording.ticks[4].device[0].flags = kFlagPaused;
  run.recording.ticks[5].device[1].flags = kFlagClamped;  // nonexistent device
  run.recording.ticks[6].device[0].flags = kFlagRotationIgnored;
  const RecordingSummary counts = summary_of(run.recording);
  EXPECT_EQ(counts.ticks, 10u);
  EXPECT_EQ(counts.clamped, 2u);
  EXPECT_EQ(counts.not_finite, 1u);
  EXPECT_EQ(counts.outside, 1u);
  EXPECT_EQ(counts.paused, 1u);
  EXPECT_EQ(counts.rotation_ignored, 1u);
  EXPECT_EQ(counts.dropped, 0u);
  // ticks lost before recording
  for (std::size_t i = 7; i < 10; ++i) run.recording.ticks[i].tick += 40;
  run.recording.ticks[9].tick += 2;
  EXPECT_EQ(summary_of(run.recording).dropped, 42u);
  // tick numbers of a damaged file
  run.recording.ticks[9].tick = 0;
  EXPECT_EQ(summary_of(run.recording).dropped, 0u);
  EXPECT_EQ(summary_of(Recording{}).ticks, 0u);
  // a complete recording contains its own summary
  run.recording.summary.emplace().clamped = 7;
  EXPECT_EQ(summary_of(run.recording).clamped, 7u);
}

TEST(Safety, ATickWithSeveralInterventionsIsOne) {
  Script run;
  run.ticks(10, 0);
  run.recording.ticks[1].device[0].flags = kFlagClamped | kFlagThermal | kFlagSlew;
  run.recording.ticks[2].device[0].flags =
      kFlagOutside | kFlagPaused | kFlagRamp | kFlagClutched | kFlagBlend;
  run.recording.ticks[3].device[0].flags = kFlagEmergencyStop;
  run.recording.ticks[4].device[1].flags = kFlagClamped;  // nonexistent device
  EXPECT_EQ(count_ticks_with(run.recording, kInterventionFlags), 2u);
  EXPECT_EQ(count_ticks_with(run.recording, kFlagSlew | kFlagOutside), 2u);
  run.recording.header.devices = 2;
  EXPECT_EQ(count_ticks_with(run.recording, kInterventionFlags), 3u);
}

TEST(Forces, ExtremesSkipNonFiniteValues) {
  Script run;
  run.ticks(5, 0, 1.25);
  run.recording.ticks[2].device[0].force_N = {std::numeric_limits<double>::infinity(), 0, 0};
  run.recording.ticks[2].device[0].heat = std::numeric_limits<double>::quiet_NaN();
  run.recording.ticks[3].device[0].limit_N = 2;
  run.recording.ticks[3].device[0].heat = 0.4;
  run.recording.ticks[4].device[0].limit_N = std::numeric_limits<double>::quiet_NaN();
  run.recording.ticks[4].device[0].heat = 0.3;
  const ForceExtremes extremes = force_extremes(run.recording);
  EXPECT_NEAR(extremes.peak_N, 1.25, 1e-12);
  EXPECT_EQ(extremes.lowest_limit_N, 2);
  EXPECT_EQ(extremes.highest_limit_N, 3);
  EXPECT_EQ(extremes.max_heat, 0.4);
}

TEST(Forces, EachTickIsHeldAgainstItsOwnLimits) {
  // the user's and scene's limit, and the effective one of the output stage
  for (const bool of_device : {false, true}) {
    SCOPED_TRACE(of_device);
    Script run;
    run.ticks(6, 0, 2.5);
    const auto limit = [&](std::size_t i) -> double& {
      TickRecord& tick = run.recording.ticks[i];
      return of_device ? tick.device[0].limit_N : tick.max_force_N;
    };
    EXPECT_EQ(force_extremes(run.recording).above_limit, 0u);
    for (std::size_t i = 0; i < 6; ++i) limit(i) = 2.5;  // clamped, including rounding
    EXPECT_EQ(force_extremes(run.recording).above_limit, 0u);
    // below the highest limit of the run, above that of its own tick
    limit(0) = 3;
    limit(1) = 2.4;
    EXPECT_EQ(force_extremes(run.recording).above_limit, 1u);
    // a non-finite force is never within a limit, and no force is within a non-finite limit
    run.recording.ticks[2].device[0].force_N = {NAN, 0, 0};
    run.recording.ticks[3].device[0].force_N = {0, -INFINITY, 0};
    limit(4) = NAN;
    EXPECT_EQ(force_extremes(run.recording).above_limit, 4u);
    // nonexistent device
    run.recording.ticks[5].device[1].force_N = {99, 0, 0};
    EXPECT_EQ(force_extremes(run.recording).above_limit, 4u);
  }
}

TEST(Forces, WhereNothingIsSentThereIsNoLimit) {
  Script run;
  run.ticks(4, 0, 0);
  run.recording.ticks[1].device[0].flags = kFlagEmergencyStop;
  run.recording.ticks[1].device[0].limit_N = 0;
  run.recording.ticks[2].device[0].flags = kFlagStale;
  run.recording.ticks[2].device[0].limit_N = 0;
  EXPECT_EQ(force_extremes(run.recording).lowest_limit_N, 3);
  EXPECT_TRUE(std::isnan(limit_N(run.recording.ticks[1].device[0])));
  EXPECT_EQ(force_extremes(run.recording).above_limit, 0u);
  // a limit of zero counts as a limit
  run.recording.ticks[3].device[0].limit_N = 0;
  EXPECT_EQ(force_extremes(run.recording).lowest_limit_N, 0);
}

TEST(Edges, AClockThatDoesNotRiseIsReplaced) {
  Script run;
  run.ticks(4, 0);
  EXPECT_EQ(run.edges().size(), 5u);
  EXPECT_NEAR(run.edges()[4], 0.004, 1e-12);
  run.recording.header.rate_hz = 500;
  for (const double broken : {std::numeric_limits<double>::quiet_NaN(), 0.0, -1.0}) {
    run.recording.ticks[2].time_s = broken;
    const auto edges = run.edges();
    for (int i = 0; i < 5; ++i) EXPECT_NEAR(edges[i], 0.002 * i, 1e-12) << broken;
  }
  EXPECT_EQ(tick_edges_s(Recording{}), std::vector<double>{0});
}

}  // namespace
}  // namespace palpate::report
