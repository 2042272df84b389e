#include "session/recording_line.h"

#include <algorithm>
#include <cmath>

#include "palpate/device.h"

namespace palpate {
namespace {

using Contact = ViewedRecording::Contact;

double length_s(const Contact& contact) {
  return contact.end_s - contact.begin_s;
}

// finite, as JSON wants it
double force_N(const DeviceTick& device) {
  const double force = std::hypot(device.force_N[0], device.force_N[1], device.force_N[2]);
  return std::isfinite(force) ? force : 0;
}

const char* name_of(Asker asker) {
  switch (asker) {
    case Asker::kSession:
      return "session";
    case Asker::kScript:
      return "script";
    case Asker::kKey:
      return "key";
    case Asker::kControlViewer:
    case Asker::kLookingViewer:
    case Asker::kAgreedViewer:
      return "viewer";
  }
  return "session";
}

std::vector<std::string> changed_keys(std::uint8_t changed) {
  constexpr std::pair<SettingBit, const char*> kKeys[] = {
      {kSettingMethod, "method"},          {kSettingFriction, "friction"}, {kSettingViscosity, "viscosity"},
      {kSettingPassivity, "passivity"},    {kSettingPaused, "paused"},     {kSettingMaxForce, "max_force_N"},
      {kSettingRotation, "rotation_wxyz"}, {kSettingPointer, "pointer"}};
  std::vector<std::string> keys;
  for (const auto& [bit, key] : kKeys)
    if ((changed & bit) != 0) keys.emplace_back(key);
  return keys;
}

ViewedRecording::Event shown(const RecordingEvent& event) {
  ViewedRecording::Event shown;
  shown.by = name_of(event.by.asker);
  shown.viewer = event.by.viewer;
  switch (event.kind) {
    case RecordingEvent::Kind::kModel:
      shown.kind = "model";
      if (event.change.tissue != ModelChange::kFieldsMadeAnew)
        shown.tissue = static_cast<int>(std::min<std::uint32_t>(event.change.tissue, 65535));
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
  }
  return shown;
}

}  // namespace

RecordingLine::RecordingLine(const RecordingHead& head) : rate_hz_(head.header.rate_hz) {
  line_.ticks = head.ticks;
  line_.force_N.resize(std::min<std::size_t>(kForces, static_cast<std::size_t>(head.ticks)));
}

void RecordingLine::see(const RecordingPart& part) {
  for (const RecordingEvent& event : part.events) see(event);
  for (const TickRecord& tick : part.ticks) see(tick);
}

void RecordingLine::see(const RecordingEvent& event) {
  const bool always = event.kind == RecordingEvent::Kind::kStop || event.kind == RecordingEvent::Kind::kRearm;
  // stops have room of their own beside the rest
  if (events_.size() >= (always ? 2 * kMostEvents : kMostEvents)) {
    ++line_.events_left_out;
    return;
  }
  events_.emplace_back(event.tick, shown(event));
}

void RecordingLine::see(const TickRecord& tick) {
  if (seen_ == 0) line_.begin_s = tick.time_s;
  line_.end_s = tick.time_s;
  for (; timed_ < events_.size() && events_[timed_].first <= tick.tick; ++timed_)
    events_[timed_].second.time_s = tick.time_s;

  const DeviceTick& device = tick.device[0];
  const double force = force_N(device);
  double& most = line_.force_N[static_cast<std::size_t>(seen_ * line_.force_N.size() / line_.ticks)];
  most = std::max(most, force);
  ++seen_;

  if (device.label == 0) return;
  auto& contacts = line_.contacts;
  const double until_s = tick.time_s + 1 / rate_hz_;
  if (!contacts.empty() && contacts.back().label == device.label &&
      tick.time_s - contacts.back().end_s < kBreak_s) {
    contacts.back().end_s = until_s;
    contacts.back().most_N = std::max(contacts.back().most_N, force);
    return;
  }
  if (contacts.size() == 2 * kMostContacts) drop_short_contacts();
  contacts.push_back({tick.time_s, until_s, device.label, force});
}

void RecordingLine::drop_short_contacts() {
  auto& contacts = line_.contacts;
  std::vector<double> lengths;
  for (const Contact& contact : contacts) lengths.push_back(length_s(contact));
  std::ranges::nth_element(lengths, lengths.begin() + kMostContacts, std::greater());
  const double least = lengths[kMostContacts];
  std::size_t equal = kMostContacts - static_cast<std::size_t>(std::ranges::count_if(
                                          contacts, [&](const Contact& c) { return length_s(c) > least; }));
  line_.contacts_left_out += contacts.size() - kMostContacts;
  std::erase_if(contacts, [&](const Contact& contact) {
    if (length_s(contact) != least) return length_s(contact) < least;
    return equal == 0 || equal-- == 0;
  });
}

ViewedRecording RecordingLine::take() {
  if (line_.contacts.size() > kMostContacts) drop_short_contacts();
  // what no tick had heard of
  line_.events_left_out += events_.size() - timed_;
  events_.resize(timed_);
  for (auto& [tick, event] : events_) line_.events.push_back(std::move(event));
  return std::move(line_);
}

}  // namespace palpate
