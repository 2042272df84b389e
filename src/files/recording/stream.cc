#include "recording/stream.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>
#include <type_traits>
#include <utility>

#include "palpate/device/device.h"
#include "recording/columns.h"
#include "recording/header_fields.h"

namespace palpate::internal {
namespace {

using reader::Receiver;
using reader::Sender;

constexpr const char* kDamaged = "the recording is damaged: ";

// text from an untrusted process is displayed to a person: printable ASCII only
std::string printable(std::string text) {
  std::ranges::replace_if(
      text, [](char c) { return c < ' ' || c > '~'; }, '?');
  return text;
}

Error receive_refusal(Receiver& in) {
  Error error{ErrorKind::kBadInput, "", "", ""};
  in.get(error.what);
  in.get(error.remedy);
  if (error.what.empty()) in.fail("HDF5 fails to read it");
  if (!in.ok()) return in.error();
  error.what = printable(error.what);
  error.remedy = printable(error.remedy);
  return error;
}

void receive_structures(Receiver& in, std::vector<RecordingHeader::Structure>& structures) {
  std::uint32_t count = 0;
  in.get(count);
  if (count > kMaxStructures) in.fail("it lists too many structures");
  std::size_t names = 0;
  for (std::uint32_t i = 0; i < count && in.ok(); ++i) {
    RecordingHeader::Structure structure{};
    in.get(structure.label);
    in.get(structure.name, kMaxText);
    in.get(structure.tissue, kMaxText);
    in.get(structure.colour.r);
    in.get(structure.colour.g);
    in.get(structure.colour.b);
    names += structure.name.size() + structure.tissue.size();
    if (names > kMaxNames) in.fail("the names of its structures are too long");
    structures.push_back(std::move(structure));
  }
}

RecordingSummary receive_summary(Receiver& in) {
  RecordingSummary summary;
  visit_summary(summary, [&](const char*, std::uint64_t& value) { in.get(value); });
  std::uint32_t count = 0;
  in.get(count);
  if (count > kMaxProblems) in.fail("it lists too many problems");
  for (std::uint32_t i = 0; i < count && in.ok(); ++i) in.get(summary.problems.emplace_back(), kMaxText);
  return summary;
}

void receive_methods(Receiver& in, std::vector<RecordingHead::AppliedMethod>& methods) {
  std::uint32_t count = 0;
  in.get(count);
  if (count > kMaxMethods) in.fail("it lists too many methods");
  for (std::uint32_t i = 0; i < count && in.ok(); ++i) {
    RecordingHead::AppliedMethod used;
    in.get(used.method);
    in.get(used.tick);
    methods.push_back(used);
  }
}

RecordingHead receive_accepted(Receiver& in) {
  RecordingHead head;
  RecordingHeader& header = head.header;
  visit_header(header, [&](const char*, auto& value) {
    if constexpr (std::is_same_v<std::decay_t<decltype(value)>, std::string>)
      in.get(value, kMaxText);
    else
      in.get(value);
  });
  in.get(header.script_text, kMaxScript);
  receive_structures(in, header.structures);
  bool complete = false;
  in.get(complete);
  if (complete) head.summary = receive_summary(in);
  in.get(head.ticks);
  in.get(head.is_clock_monotonic);
  receive_methods(in, head.methods);

  if (header.devices < 1 || header.devices > kMaxDevices)
    in.fail("it names " + std::to_string(header.devices) + " devices");
  if (!std::isfinite(header.rate_hz) || header.rate_hz <= 0) in.fail("its rate is not a number above 0 Hz");
  if (header.clock != kVirtualClock && header.clock != kRealClock)
    in.fail("its clock is neither virtual nor real");
  if (head.summary && head.summary->ticks != head.ticks)
    in.fail("its summary counts " + std::to_string(head.summary->ticks) + " ticks, but the data sets have " +
            std::to_string(head.ticks));
  return head;
}

// Receives one column into rows; `record` maps a row to the struct to which the column's offset refers.
template <class Row, class Record>
void receive_column(Receiver& in, const Column& column, std::span<Row> rows, std::vector<std::byte>& buffer,
                    Record&& record) {
  const std::size_t width = column.row_bytes();
  buffer.resize(rows.size() * width);
  in.get_bytes(buffer);
  if (!in.ok()) return;
  for (std::size_t row = 0; row < rows.size(); ++row)
    std::memcpy(reinterpret_cast<std::byte*>(record(rows[row])) + column.offset, buffer.data() + row * width,
                width);
}

void receive_ticks(Receiver& in, int devices, std::span<TickRecord> ticks, std::vector<std::byte>& buffer) {
  for (const Column& column : tick_columns())
    receive_column(in, column, ticks, buffer, [](TickRecord& tick) { return &tick; });
  for (std::size_t d = 0; d < static_cast<std::size_t>(devices); ++d)
    for (const Column& column : device_columns())
      receive_column(in, column, ticks, buffer, [d](TickRecord& tick) { return &tick.device[d]; });
  for (TickRecord& tick : ticks) tick.devices = devices;
}

bool is_valid_sweep(const SweepRecord& sweep) {
  constexpr double kMaxCoordinate_mm = 1e6, kMaxRadius_mm = 10;
  const auto is_in_range = [](double mm) { return std::abs(mm) <= kMaxCoordinate_mm; };
  constexpr double kMaxAxis_mm = 30;
  const auto is_axis_in_range = [](double mm) { return std::abs(mm) <= kMaxAxis_mm; };
  double distance_mm = 0;
  for (std::size_t axis = 0; axis < 3; ++axis)
    distance_mm = std::max(distance_mm, std::abs(sweep.to_mm[axis] - sweep.from_mm[axis]));
  const bool has_axis = std::ranges::any_of(sweep.axis_mm, [](double mm) { return mm != 0; });
  if (!std::ranges::all_of(sweep.axis_mm, is_axis_in_range) || !(sweep.end_radius_mm <= kMaxRadius_mm) ||
      !(has_axis ? sweep.end_radius_mm > 0 : sweep.end_radius_mm == 0))
    return false;
  const bool is_known = sweep.device < kMaxDevices || sweep.device == SweepRecord::kBrokenOff;
  return is_known && std::ranges::all_of(sweep.from_mm, is_in_range) &&
         std::ranges::all_of(sweep.to_mm, is_in_range) && sweep.radius_mm > 0 &&
         sweep.radius_mm <= kMaxRadius_mm && distance_mm <= kMaxRadius_mm;
}

// @param last_tick  in: tick of the preceding event; out: tick of the last one
void receive_events(Receiver& in, std::span<RecordingEvent> events, std::uint64_t& last_tick,
                    std::vector<std::byte>& buffer) {
  for (const Column& column : event_columns())
    receive_column(in, column, events, buffer, [](RecordingEvent& event) { return &event; });
  for (RecordingEvent& event : events) {
    if (event.kind > RecordingEvent::Kind::kTissueSolution) in.fail("an event has an unknown kind");
    if (event.by.originator > Originator::kViewerWithConsent) in.fail("an event has an unknown source");
    if (event.tick < last_tick) in.fail("its events are out of order");
    last_tick = event.tick;
    if (event.kind == RecordingEvent::Kind::kSweep && !is_valid_sweep(event.sweep))
      in.fail("a sweep is invalid");
    event.change.version = event.kind == RecordingEvent::Kind::kModel ? event.number : 0;
  }
}

void send_summary(Sender& out, const RecordingSummary& summary) {
  visit_summary(summary, [&](const char*, std::uint64_t value) { out.put(value); });
  out.put(static_cast<std::uint32_t>(summary.problems.size()));
  for (const std::string& sentence : summary.problems) out.put(sentence);
}

}  // namespace

bool send_refusal(ByteTarget& target, const Error& refusal) {
  Sender out(target);
  out.put(std::uint8_t{0});
  out.put(refusal.what);
  out.put(refusal.remedy);
  return out.ok();
}

bool send_head(ByteTarget& target, const RecordingHead& head) {
  Sender out(target);
  out.put(std::uint8_t{1});
  visit_header(head.header, [&](const char*, const auto& value) { out.put(value); });
  out.put(head.header.script_text);
  out.put(static_cast<std::uint32_t>(head.header.structures.size()));
  for (const auto& structure : head.header.structures) {
    out.put(structure.label);
    out.put(structure.name);
    out.put(structure.tissue);
    out.put(structure.colour.r);
    out.put(structure.colour.g);
    out.put(structure.colour.b);
  }
  out.put(head.summary.has_value());
  if (head.summary) send_summary(out, *head.summary);
  out.put(head.ticks);
  out.put(head.is_clock_monotonic);
  out.put(static_cast<std::uint32_t>(head.methods.size()));
  for (const RecordingHead::AppliedMethod& used : head.methods) {
    out.put(used.method);
    out.put(used.tick);
  }
  return out.ok();
}

bool send_events(ByteTarget& target, std::span<const RecordingEvent> events, std::uint32_t ticks) {
  Sender out(target);
  out.put(static_cast<std::uint32_t>(events.size()));
  out.put(ticks);
  std::vector<std::byte> values;
  for (const Column& column : event_columns()) {
    values.clear();
    for (const RecordingEvent& event : events) {
      const auto* first = reinterpret_cast<const std::byte*>(&event) + column.offset;
      values.insert(values.end(), first, first + column.row_bytes());
    }
    if (out.ok() && !target.write(values)) return false;
  }
  return out.ok();
}

void TickProperties::observe(std::uint64_t tick, double time_s, std::uint8_t method) {
  is_clock_monotonic_ = is_clock_monotonic_ && std::isfinite(time_s) && (ticks_ == 0 || time_s > last_s_);
  last_s_ = time_s;
  ++ticks_;
  if (std::exchange(method_seen_[method], true)) return;
  methods_.push_back({method, tick});
}

void TickProperties::write_to(RecordingHead& head) const {
  head.ticks = ticks_;
  head.is_clock_monotonic = is_clock_monotonic_;
  head.methods = methods_;
}

bool TickProperties::agrees_with(const RecordingHead& head) const {
  const auto same = [](const RecordingHead::AppliedMethod& a, const RecordingHead::AppliedMethod& b) {
    return a.method == b.method && a.tick == b.tick;
  };
  return (is_clock_monotonic_ || !head.is_clock_monotonic) && methods_.size() <= head.methods.size() &&
         std::equal(methods_.begin(), methods_.end(), head.methods.begin(), same);
}

std::size_t events_up_to(std::span<const RecordingEvent> events, std::uint64_t tick) {
  const auto after = [&](const RecordingEvent& event) { return event.tick > tick; };
  return static_cast<std::size_t>(std::ranges::find_if(events, after) - events.begin());
}

Result<RecordingHead> receive_head(ByteSource& source) {
  Receiver in(source, kDamaged);
  bool accepted = false;
  in.get(accepted);
  if (in.ok() && !accepted) return receive_refusal(in);
  RecordingHead head = receive_accepted(in);
  if (!in.ok()) return in.error();
  return head;
}

Result<void> receive_parts(ByteSource& source, const RecordingHead& head,
                           const std::function<Result<void>(const RecordingPart&)>& visit,
                           const Progress& progress) {
  Receiver in(source, kDamaged);
  std::vector<TickRecord> ticks;
  std::vector<RecordingEvent> events;
  std::vector<std::byte> buffer;
  std::uint64_t last_event_tick = 0;
  TickProperties properties;
  for (std::uint64_t left = head.ticks; left > 0;) {
    if (progress.stopped()) return Progress::interrupted();
    std::uint32_t event_count = 0, tick_count = 0;
    in.get(event_count);
    in.get(tick_count);
    if (event_count > kBlockRows || tick_count > std::min(kBlockRows, left) || event_count + tick_count == 0)
      in.fail("a part of it has an invalid size");
    if (!in.ok()) return in.error();

    events.assign(event_count, {});
    receive_events(in, events, last_event_tick, buffer);
    ticks.assign(tick_count, {});
    receive_ticks(in, head.header.devices, ticks, buffer);
    for (const TickRecord& tick : ticks) properties.observe(tick.tick, tick.time_s, tick.method);
    if (!properties.agrees_with(head)) in.fail("its ticks contradict its header");
    if (!in.ok()) return in.error();
    if (auto used = visit({ticks, events}); !used) return used;
    left -= tick_count;
  }
  return {};
}

}  // namespace palpate::internal
