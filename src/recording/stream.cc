#include "recording/stream.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <type_traits>

#include "palpate/device.h"
#include "recording/columns.h"
#include "recording/header_fields.h"

namespace palpate::internal {
namespace {

class Sender {
 public:
  explicit Sender(ByteTarget& target) : target_(target) {}
  bool ok() const { return ok_; }

  template <class Plain>
  requires std::is_arithmetic_v<Plain>
  void put(const Plain& value) { put_bytes(std::as_bytes(std::span(&value, 1))); }
  void put(const std::string& text) {
    put(static_cast<std::uint32_t>(text.size()));
    put_bytes(std::as_bytes(std::span(text)));
  }

 private:
  void put_bytes(std::span<const std::byte> bytes) { ok_ = ok_ && target_.write(bytes); }

  ByteTarget& target_;
  bool ok_ = true;
};

// Reads fields; after the first failure values stay as they are and error() tells why.
class Receiver {
 public:
  explicit Receiver(ByteSource& source) : source_(source) {}
  bool ok() const { return !error_.has_value(); }
  const Error& error() const { return *error_; }

  template <class Plain>
  requires std::is_arithmetic_v<Plain>
  void get(Plain& value) {
    Plain read{};
    get_bytes(std::as_writable_bytes(std::span(&read, 1)));
    if (ok()) value = read;
  }
  void get(bool& value) {
    std::uint8_t byte = 0;
    get(byte);
    value = byte != 0;
  }
  void get(std::string& text, std::size_t most = kMaxText) {
    std::uint32_t size = 0;
    get(size);
    if (size > most) fail("a text of it is too long");
    if (!ok()) return;
    text.resize(size);
    get_bytes(std::as_writable_bytes(std::span(text)));
  }
  void get_bytes(std::span<std::byte> bytes) {
    if (!ok()) return;
    if (auto read = source_.read(bytes); !read) error_ = read.error();
  }
  void fail(const std::string& what) {
    if (ok()) error_ = Error{ErrorKind::kBadInput, "the recording is damaged: " + what, "", ""};
  }

 private:
  ByteSource& source_;
  std::optional<Error> error_;
};

// what another process says is shown to a person: printable ASCII only
std::string printable(std::string text) {
  std::ranges::replace_if(
      text, [](char c) { return c < ' ' || c > '~'; }, '?');
  return text;
}

Error receive_refusal(Receiver& in) {
  Error error{ErrorKind::kBadInput, "", "", ""};
  in.get(error.what);
  in.get(error.remedy);
  if (error.what.empty()) in.fail("HDF5 fails on it");
  if (!in.ok()) return in.error();
  error.what = printable(error.what);
  error.remedy = printable(error.remedy);
  return error;
}

void receive_structures(Receiver& in, std::vector<RecordingHeader::Structure>& structures) {
  std::uint32_t count = 0;
  in.get(count);
  if (count > kMaxStructures) in.fail("it lists too many structures");
  for (std::uint32_t i = 0; i < count && in.ok(); ++i) {
    RecordingHeader::Structure structure{};
    in.get(structure.label);
    in.get(structure.name);
    in.get(structure.tissue);
    in.get(structure.colour.r);
    in.get(structure.colour.g);
    in.get(structure.colour.b);
    structures.push_back(std::move(structure));
  }
}

RecordingSummary receive_summary(Receiver& in) {
  RecordingSummary summary;
  visit_summary(summary, [&](const char*, std::uint64_t& value) { in.get(value); });
  std::uint32_t count = 0;
  in.get(count);
  if (count > kMaxTroubles) in.fail("it lists too many troubles");
  for (std::uint32_t i = 0; i < count && in.ok(); ++i) in.get(summary.trouble.emplace_back());
  in.get(count);
  if (count > kMaxChanges) in.fail("it lists too many changes of the model");
  for (std::uint32_t i = 0; i < count && in.ok(); ++i) {
    ChangeRow row{};
    for (double& value : row) in.get(value);
    const auto change = change_of(row);
    if (!change) in.fail("a change of the model has no version or tissue");
    summary.changes.push_back(change.value_or(ModelChange{}));
  }
  return summary;
}

RecordingHead receive_head(Receiver& in) {
  RecordingHead head;
  RecordingHeader& header = head.header;
  visit_header(header, [&](const char*, auto& value) { in.get(value); });
  in.get(header.script_text, kMaxScript);
  receive_structures(in, header.structures);
  bool complete = false;
  in.get(complete);
  if (complete) head.summary = receive_summary(in);
  in.get(head.rows);

  if (header.devices < 1 || header.devices > kMaxDevices)
    in.fail("it names " + std::to_string(header.devices) + " devices");
  if (!std::isfinite(header.rate_hz) || header.rate_hz <= 0) in.fail("its rate is not a number above 0 Hz");
  if (header.clock != kVirtualClock && header.clock != kRealClock)
    in.fail("its clock is neither virtual nor real");
  if (head.summary && head.summary->ticks != head.rows)
    in.fail("its summary counts " + std::to_string(head.summary->ticks) + " ticks, the data sets hold " +
            std::to_string(head.rows));
  return head;
}

// one column of a block into the ticks it belongs to; `record` finds the TickRecord's part
template <class Record>
void receive_column(Receiver& in, const Column& column, std::span<TickRecord> ticks,
                    std::vector<std::byte>& buffer, Record&& record) {
  const std::size_t width = column.row_bytes();
  buffer.resize(ticks.size() * width);
  in.get_bytes(buffer);
  if (!in.ok()) return;
  for (std::size_t row = 0; row < ticks.size(); ++row)
    std::memcpy(reinterpret_cast<std::byte*>(record(ticks[row])) + column.offset, buffer.data() + row * width,
                width);
}

void receive_block(Receiver& in, int devices, std::span<TickRecord> ticks, std::vector<std::byte>& buffer) {
  for (const Column& column : tick_columns())
    receive_column(in, column, ticks, buffer, [](TickRecord& tick) { return &tick; });
  for (std::size_t d = 0; d < static_cast<std::size_t>(devices); ++d)
    for (const Column& column : device_columns())
      receive_column(in, column, ticks, buffer, [d](TickRecord& tick) { return &tick.device[d]; });
  for (TickRecord& tick : ticks) tick.devices = devices;
}

void send_summary(Sender& out, const RecordingSummary& summary) {
  visit_summary(summary, [&](const char*, std::uint64_t value) { out.put(value); });
  out.put(static_cast<std::uint32_t>(summary.trouble.size()));
  for (const std::string& sentence : summary.trouble) out.put(sentence);
  out.put(static_cast<std::uint32_t>(summary.changes.size()));
  for (const ModelChange& change : summary.changes)
    for (const double value : row_of(change)) out.put(value);
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
  out.put(head.rows);
  return out.ok();
}

Result<Recording> receive_recording(ByteSource& source, const Progress& progress) {
  Receiver in(source);
  bool accepted = false;
  in.get(accepted);
  if (in.ok() && !accepted) return receive_refusal(in);
  RecordingHead head = receive_head(in);

  // memory is taken as the rows arrive, not as their number promises
  Recording recording{std::move(head.header), {}, std::move(head.summary)};
  std::vector<std::byte> buffer;
  for (std::uint64_t first = 0; first < head.rows && in.ok(); first += kBlockRows) {
    progress.report("reading the recording", static_cast<double>(first) / static_cast<double>(head.rows));
    const std::size_t rows = static_cast<std::size_t>(std::min(kBlockRows, head.rows - first));
    recording.ticks.resize(recording.ticks.size() + rows);
    receive_block(in, recording.header.devices, std::span(recording.ticks).last(rows), buffer);
  }
  if (!in.ok()) return in.error();
  return recording;
}

}  // namespace palpate::internal
