#include "session/recording_timeline.h"

#include <algorithm>
#include <cmath>

#include "palpate/device/device.h"

namespace palpate {
namespace {

using Contact = ViewedRecording::Contact;

double length_s(const Contact& contact) {
  return contact.end_s - contact.begin_s;
}

// JSON has no representation of NaN and infinity
double force_N(const DeviceTick& device) {
  const double force = std::hypot(device.force_N[0], device.force_N[1], device.force_N[2]);
  return std::isfinite(force) ? force : 0;
}

const char* name_of(Originator originator) {
  switch (originator) {
    case Originator::kSession:
      return "session";
    case Originator::kScript:
      return "script";
    case Originator::kKey:
      return "key";
    case Originator::kControlViewer:
    case Originator::kViewingViewer:
    case Originator::kViewerWithConsent:
      return "viewer";
  }
  return "session";
}

std::vector<std::string> changed_keys(std::uint16_t changed) {
  std::vector<std::string> keys;
  visit_settings([&](const auto& setting) {
    if ((changed & setting.changed) != 0) keys.emplace_back(setting.name);
  });
  if ((changed & kSettingPointer) != 0) keys.emplace_back("pointer");
  return keys;
}

ViewedRecording::Event shown(const RecordingEvent& event) {
  ViewedRecording::Event shown;
  shown.by = name_of(event.by.originator);
  shown.viewer = event.by.viewer;
  switch (event.kind) {
    case RecordingEvent::Kind::kModel:
      shown.kind = event.change.tissue == ModelChange::kUndo   ? "undo"
                   : event.change.tissue == ModelChange::kRedo ? "redo"
                                                               : "model";
      if (event.change.is_of_tissue())
        shown.tissue = static_cast<int>(std::min<std::uint32_t>(event.change.tissue, 65535));
      if (event.change.is_of_law()) {
        shown.kind = "settings";
        shown.changed = {std::string(kLawSetting)};
      }
      break;
    case RecordingEvent::Kind::kSettings:
      shown.kind = "settings";
      shown.changed = changed_keys(event.changed);
      break;
    case RecordingEvent::Kind::kStop:
      shown.kind = "stop";
      break;
    case RecordingEvent::Kind::kRearm:
      shown.kind = "rearm";
      break;
    case RecordingEvent::Kind::kSweep:
    case RecordingEvent::Kind::kTissueSolution:
      break;
  }
  return shown;
}

}  // namespace

RecordingTimeline::RecordingTimeline(const RecordingHead& head)
    : rate_hz_(head.header.rate_hz), devices_(head.header.devices) {
  line_.ticks = head.ticks;
  line_.force_N.resize(std::min<std::size_t>(kForceIntervals, static_cast<std::size_t>(head.ticks)));
}

void RecordingTimeline::observe(const RecordingPart& part) {
  for (const RecordingEvent& event : part.events) observe(event);
  for (const TickRecord& tick : part.ticks) observe(tick);
}

void RecordingTimeline::observe(const RecordingEvent& event) {
  // a burr produces a hundred sweeps per second, each a model version too; tissue produces 64 solutions per
  // second
  const bool cut = event.kind == RecordingEvent::Kind::kModel && event.change.tissue == ModelChange::kCut;
  if (cut || event.kind == RecordingEvent::Kind::kSweep ||
      event.kind == RecordingEvent::Kind::kTissueSolution)
    return;
  const bool always = event.kind == RecordingEvent::Kind::kStop || event.kind == RecordingEvent::Kind::kRearm;
  // stops and rearms have a separate quota
  if (events_.size() >= (always ? 2 * kMaxEvents : kMaxEvents)) {
    ++line_.omitted_events;
    return;
  }
  events_.emplace_back(event.tick, shown(event));
}

void RecordingTimeline::observe(const TickRecord& tick) {
  if (tick_count_ == 0) line_.begin_s = tick.time_s;
  line_.end_s = tick.time_s;
  for (; timed_event_count_ < events_.size() && events_[timed_event_count_].first <= tick.tick;
       ++timed_event_count_)
    events_[timed_event_count_].second.time_s = tick.time_s;

  double& largest = line_.force_N[static_cast<std::size_t>(tick_count_ * line_.force_N.size() / line_.ticks)];
  for (int d = 0; d < devices_; ++d) {
    largest = std::max(largest, force_N(tick.device[d]));
    observe(d, tick.device[d], tick.time_s);
  }
  ++tick_count_;
}

void RecordingTimeline::observe(int device, const DeviceTick& tick, double time_s) {
  if (tick.label == 0) return;
  Contact& contact = open_[device];
  if (contact.label != tick.label || time_s - contact.end_s >= kMaxContactGap_s) {
    end(contact);
    contact = {time_s, time_s, tick.label, 0, device};
  }
  contact.end_s = time_s + 1 / rate_hz_;
  contact.max_N = std::max(contact.max_N, force_N(tick));
}

void RecordingTimeline::end(Contact& contact) {
  if (contact.label == 0) return;
  if (line_.contacts.size() == 2 * kMaxContacts) drop_short_contacts();
  line_.contacts.push_back(contact);
}

void RecordingTimeline::drop_short_contacts() {
  auto& contacts = line_.contacts;
  std::vector<double> lengths;
  for (const Contact& contact : contacts) lengths.push_back(length_s(contact));
  std::ranges::nth_element(lengths, lengths.begin() + kMaxContacts, std::greater());
  const double smallest = lengths[kMaxContacts];
  std::size_t equal = kMaxContacts - static_cast<std::size_t>(std::ranges::count_if(
                                         contacts, [&](const Contact& c) { return length_s(c) > smallest; }));
  line_.omitted_contacts += contacts.size() - kMaxContacts;
  std::erase_if(contacts, [&](const Contact& contact) {
    if (length_s(contact) != smallest) return length_s(contact) < smallest;
    return equal == 0 || equal-- == 0;
  });
}

ViewedRecording RecordingTimeline::take() {
  for (Contact& contact : open_) end(contact);
  if (line_.contacts.size() > kMaxContacts) drop_short_contacts();
  // a contact of one device may have begun before another device's contact that ended earlier
  std::ranges::stable_sort(line_.contacts, {}, &Contact::begin_s);
  // events after the last tick
  line_.omitted_events += events_.size() - timed_event_count_;
  events_.resize(timed_event_count_);
  for (auto& [tick, event] : events_) line_.events.push_back(std::move(event));
  return std::move(line_);
}

}  // namespace palpate
