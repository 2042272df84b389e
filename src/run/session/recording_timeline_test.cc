#include "session/recording_timeline.h"

#include <gtest/gtest.h>

#include "palpate/device/device.h"

namespace palpate {
namespace {

// ticks at 1 kHz with these labels in sequence; the force in newtons equals the label
ViewedRecording line_of(const std::vector<LabelId>& labels, const std::vector<RecordingEvent>& events = {}) {
  RecordingHead head;
  head.header.rate_hz = 1000;
  head.ticks = labels.size();
  std::vector<TickRecord> ticks(labels.size());
  for (std::size_t i = 0; i < labels.size(); ++i) {
    ticks[i].tick = i;
    ticks[i].time_s = 0.001 * static_cast<double>(i);
    ticks[i].device[0].label = labels[i];
    ticks[i].device[0].force_N = {0, 0, static_cast<double>(labels[i])};
  }
  RecordingTimeline line(head);
  line.observe({ticks, events});
  return line.take();
}

RecordingEvent event(RecordingEvent::Kind kind, std::uint64_t tick, RequestedBy by = {}) {
  RecordingEvent event;
  event.kind = kind;
  event.tick = tick;
  event.by = by;
  return event;
}

TEST(RecordingTimeline, HasTheContactsAndTheirGreatestForces) {
  // contact of 100 ms, a gap below the threshold, another structure, a gap above the threshold
  std::vector<LabelId> labels(100, 1);
  labels.insert(labels.end(), 40, 0);
  labels.insert(labels.end(), 60, 1);
  labels.insert(labels.end(), 50, 2);
  labels.insert(labels.end(), 100, 0);
  labels.insert(labels.end(), 10, 2);
  const ViewedRecording line = line_of(labels);
  ASSERT_EQ(line.contacts.size(), 3u);
  EXPECT_NEAR(line.contacts[0].begin_s, 0, 1e-12);
  EXPECT_NEAR(line.contacts[0].end_s, 0.2, 1e-12);
  EXPECT_EQ(line.contacts[1].label, 2);
  EXPECT_EQ(line.contacts[1].max_N, 2);
  EXPECT_NEAR(line.contacts[2].begin_s, 0.35, 1e-12);
  EXPECT_NEAR(line.end_s, 0.359, 1e-12);
  ASSERT_EQ(line.force_N.size(), labels.size());
  EXPECT_EQ(line.force_N[180], 1);
  EXPECT_EQ(line.force_N[355], 2);
}

TEST(RecordingTimeline, HasTheContactsOfAllDevices) {
  // one device rests on a structure while the other makes and breaks contact
  RecordingHead head;
  head.header.rate_hz = 1000;
  head.header.devices = 2;
  head.ticks = 400;
  std::vector<TickRecord> ticks(400);
  for (std::size_t i = 0; i < ticks.size(); ++i) {
    ticks[i].tick = i;
    ticks[i].time_s = 0.001 * static_cast<double>(i);
    ticks[i].device[0].label = i >= 20 && i < 380 ? 1 : 0;
    ticks[i].device[0].force_N = {1, 0, 0};
    ticks[i].device[1].label = i % 200 >= 50 && i % 200 < 100 ? 2 : 0;
    ticks[i].device[1].force_N = {0, i < 200 ? 3.0 : 0.5, 0};
  }
  RecordingTimeline recorded(head);
  recorded.observe({ticks, {}});
  const ViewedRecording line = recorded.take();
  ASSERT_EQ(line.contacts.size(), 3u);
  EXPECT_EQ(line.contacts[0].device, 0);
  EXPECT_NEAR(line.contacts[0].begin_s, 0.02, 1e-12);
  EXPECT_NEAR(line.contacts[0].end_s, 0.38, 1e-12);
  EXPECT_EQ(line.contacts[0].max_N, 1);
  for (const std::size_t n : {1u, 2u}) {
    EXPECT_EQ(line.contacts[n].device, 1);
    EXPECT_EQ(line.contacts[n].label, 2);
    EXPECT_NEAR(line.contacts[n].begin_s, n == 1 ? 0.05 : 0.25, 1e-12);
    EXPECT_EQ(line.contacts[n].max_N, n == 1 ? 3 : 0.5);
  }
  EXPECT_EQ(line.force_N[10], 3);
  EXPECT_EQ(line.force_N[300], 1);
}

TEST(RecordingTimeline, KeepsTheLongestContacts) {
  // contacts of 1 to 7 ticks, far apart
  std::vector<LabelId> labels;
  std::size_t all = 0;
  for (; all < 9000; ++all) {
    labels.insert(labels.end(), 1 + all % 7, static_cast<LabelId>(1 + all % 3));
    labels.insert(labels.end(), 60, 0);
  }
  const ViewedRecording line = line_of(labels);
  EXPECT_EQ(line.contacts.size(), RecordingTimeline::kMaxContacts);
  EXPECT_EQ(line.contacts.size() + line.omitted_contacts, all);
  // 1286 contacts of seven ticks, the rest of six
  for (const auto& contact : line.contacts) EXPECT_GT(contact.end_s - contact.begin_s, 0.0055);
  EXPECT_TRUE(std::ranges::is_sorted(line.contacts, {}, &ViewedRecording::Contact::begin_s));
  EXPECT_EQ(line.force_N.size(), RecordingTimeline::kForceIntervals);
}

TEST(RecordingTimeline, HasTheSettingChanges) {
  RecordingEvent settings = event(RecordingEvent::Kind::kSettings, 2, {Originator::kControlViewer, 3});
  settings.changed = kSettingMethod | kSettingMaxForce;
  RecordingEvent model = event(RecordingEvent::Kind::kModel, 4, {Originator::kScript, 0});
  model.change.tissue = 1;
  const auto stop = event(RecordingEvent::Kind::kStop, 5, {Originator::kKey, 0});
  const ViewedRecording line =
      line_of(std::vector<LabelId>(8, 0), {settings, model, stop, event(RecordingEvent::Kind::kRearm, 9)});
  ASSERT_EQ(line.events.size(), 3u);
  EXPECT_EQ(line.events[0].kind, "settings");
  EXPECT_EQ(line.events[0].changed, (std::vector<std::string>{"method", "max_force_N"}));
  EXPECT_EQ(line.events[0].by, "viewer");
  EXPECT_EQ(line.events[0].viewer, 3u);
  EXPECT_EQ(line.events[1].kind, "model");
  EXPECT_EQ(line.events[1].tissue, 1);
  EXPECT_EQ(line.events[1].by, "script");
  EXPECT_EQ(line.events[2].kind, "stop");
  EXPECT_NEAR(line.events[2].time_s, 0.005, 1e-12);
  EXPECT_EQ(line.omitted_events, 1u);
}

TEST(RecordingTimeline, HasStrokesThatWereUndoneAndNoCuts) {
  std::vector<RecordingEvent> events;
  for (const std::uint32_t what : {ModelChange::kCut, ModelChange::kUndo, ModelChange::kRedo}) {
    events.push_back(event(RecordingEvent::Kind::kModel, 4, {Originator::kControlViewer, 1}));
    events.back().change.tissue = what;
  }
  const ViewedRecording line = line_of(std::vector<LabelId>(8, 0), events);
  ASSERT_EQ(line.events.size(), 2u);
  EXPECT_EQ(line.events[0].kind, "undo");
  EXPECT_EQ(line.events[0].tissue, -1);
  EXPECT_EQ(line.events[1].kind, "redo");
}

TEST(RecordingTimeline, KeepsStopsAmongManyEvents) {
  std::vector<RecordingEvent> events;
  for (std::size_t i = 0; i < 3 * RecordingTimeline::kMaxEvents; ++i)
    events.push_back(event(RecordingEvent::Kind::kSettings, 1));
  events.push_back(event(RecordingEvent::Kind::kStop, 2));
  const ViewedRecording line = line_of(std::vector<LabelId>(4, 0), events);
  EXPECT_EQ(line.events.size(), RecordingTimeline::kMaxEvents + 1);
  EXPECT_EQ(line.events.back().kind, "stop");
  EXPECT_EQ(line.omitted_events, 2 * RecordingTimeline::kMaxEvents);
}

}  // namespace
}  // namespace palpate
