#include <algorithm>
#include <array>
#include <cstring>
#include <functional>
#include <memory>
#include <new>
#include <system_error>

#include "palpate/base/file.h"
#include "palpate/reader/reader_process.h"
#include "recording/hdf5_handle.h"
#include "recording/hdf5_reader.h"

// HDF5 is not safe against malicious files, so a sandboxed process opens them (reader_process.h) and sends
// plain rows (stream.h).
namespace palpate {
namespace internal {
namespace {

std::optional<Error> not_hdf5(const InputFile& opened, const std::filesystem::path& file) {
  // HDF5's signature may be at 0, 512, 1024, 2048, ...
  for (std::uint64_t at = 0; at < opened.size(); at = at == 0 ? 512 : 2 * at) {
    std::array<std::byte, 8> bytes{};
    if (const auto received = opened.read_at(at, bytes); !received) return received.error();
    if (std::memcmp(bytes.data(), "\x89HDF\r\n\x1a\n", bytes.size()) == 0) return std::nullopt;
  }
  return Error{ErrorKind::kBadInput, "is not a recording: it is not an HDF5 file", file.string(),
               "name a file that palpate simulate or explore wrote"};
}

// @param progress  must stay valid for the lifetime of the process
Result<std::unique_ptr<reader::ReaderProcess>> start_reader(const InputFile& file,
                                                            std::optional<RowRange> range,
                                                            const Progress& progress) {
  const int descriptor = file.descriptor();
  reader::ReaderProcess::Job job;
  job.files = {&descriptor, 1};
  job.death_error = "the recording is damaged: HDF5 fails to read it";
  job.timeout_error = "the recording is damaged: HDF5 does not finish reading it";
  const auto name = file.name_for_libraries();
  const Hdf5Section section;
  return reader::ReaderProcess::start(
      job, [&](reader::ParentEnd& parent) { return send_recording(name, parent, range); }, progress);
}

using TakeHead = std::function<Result<bool>(const RecordingHead&)>;
using TakePart = std::function<Result<void>(const RecordingPart&)>;

// adds the file name to errors of the file or of reading it, not to those of the consumer
Error about(const std::filesystem::path& file, Error error) {
  if (error.kind != ErrorKind::kInterrupted) error.where = file.string();
  return error;
}

/// @param range      as for send_recording
/// @param read_head  returns whether the parts are wanted too
Result<void> read_isolated(const std::filesystem::path& file, std::optional<RowRange> range,
                           const TakeHead& read_head, const TakePart& read_part,
                           const Progress& progress) try {
  const auto opened = InputFile::open(file);
  if (!opened) return opened.error();
  if (auto error = not_hdf5(*opened, file)) return *error;
  const auto process = start_reader(*opened, range, progress);
  if (!process) return about(file, process.error());
  ByteSource& source = **process;
  auto received = receive_head(source);
  if (!received) return about(file, received.error());
  const RecordingHead head = *std::move(received);
  const auto wants_ticks = read_head(head);
  if (!wants_ticks) return wants_ticks.error();
  if (!*wants_ticks) return {};
  bool consumer_failed = false;
  auto done = receive_parts(
      source, head,
      [&](const RecordingPart& part) {
        auto used = read_part(part);
        consumer_failed = !used;
        return used;
      },
      progress);
  if (done || consumer_failed) return done;
  return about(file, done.error());
} catch (const std::bad_alloc&) {
  return Error{ErrorKind::kBadInput, "the recording does not fit in memory", file.string(), ""};
}

std::filesystem::file_time_type last_change(const std::filesystem::path& file) {
  std::error_code failed;
  return std::filesystem::last_write_time(file, failed);
}

bool same_run(const RecordingHeader& a, const RecordingHeader& b) {
  return a.started_utc == b.started_utc && a.model_hash == b.model_hash && a.seed == b.seed &&
         a.devices == b.devices && a.script_text == b.script_text;
}

/// Reading while another process writes: a slow reader may observe an index in the middle of an update, so it
/// retries.
/// @param inspect  reads everything that it needs, from the beginning each time
Result<void> read_beside_writer(const std::filesystem::path& file,
                                const std::function<Result<void>()>& inspect) {
  constexpr int kMaxAttempts = 20;
  for (int attempt = 1;; ++attempt) {
    const auto before = last_change(file);
    auto read = inspect();
    const bool was_written = last_change(file) != before;
    if (read || read.error().kind != ErrorKind::kBadInput || !was_written || attempt == kMaxAttempts)
      return read;
  }
}

Error replaced(const std::filesystem::path& file) {
  return {ErrorKind::kBadInput, "the recording was replaced while it was read", file.string(),
          "try again when no program writes to it"};
}

}  // namespace
}  // namespace internal

Result<RecordingSource> RecordingSource::open(const std::filesystem::path& file, const Progress& progress) {
  RecordingHead head;
  const auto read_head = [&](const RecordingHead& read) -> Result<bool> {
    head = read;
    return false;
  };
  const auto read = internal::read_beside_writer(
      file, [&] { return internal::read_isolated(file, std::nullopt, read_head, {}, progress); });
  if (!read) return read.error();
  return RecordingSource(file, std::move(head));
}

RecordingSource::RecordingSource(const Recording& recording) : memory_(&recording) {
  head_.header = recording.header;
  head_.summary = recording.summary;
  internal::TickProperties properties;
  for (const TickRecord& tick : recording.ticks) properties.observe(tick.tick, tick.time_s, tick.method);
  properties.write_to(head_);
}

Result<void> RecordingSource::read(const std::function<Result<void>(const RecordingPart&)>& visit,
                                   const Progress& progress) const {
  // exactly the number of ticks that the head announced, with their events
  std::uint64_t left = head_.ticks;
  const auto accept_known = [&](RecordingPart part) -> Result<void> {
    if (left == 0) return {};
    if (part.ticks.size() > left) {
      part.ticks = part.ticks.first(static_cast<std::size_t>(left));
      part.events = part.events.first(internal::events_up_to(part.events, part.ticks.back().tick));
    }
    left -= part.ticks.size();
    return visit(part);
  };
  if (memory_ == nullptr) {
    const auto read_head = [&](const RecordingHead& now) -> Result<bool> {
      if (internal::same_run(now.header, head_.header) && now.ticks >= head_.ticks) return true;
      return internal::replaced(file_);
    };
    return internal::read_isolated(file_, std::nullopt, read_head, accept_known, progress);
  }

  std::span<const TickRecord> ticks(memory_->ticks);
  std::span<const RecordingEvent> events(memory_->events);
  while (!ticks.empty()) {
    if (progress.stopped()) return Progress::interrupted();
    const auto part = ticks.first(std::min<std::size_t>(ticks.size(), internal::kBlockRows));
    const std::size_t event_count = internal::events_up_to(events, part.back().tick);
    if (auto used = accept_known({part, events.first(event_count)}); !used) return used;
    ticks = ticks.subspan(part.size());
    events = events.subspan(event_count);
  }
  return {};
}

Result<std::vector<TickRecord>> RecordingSource::read_at(std::uint64_t first, std::uint64_t count,
                                                         const Progress& progress) const {
  first = std::min(first, head_.ticks);
  count = std::min(count, head_.ticks - first);
  if (memory_ != nullptr) {
    const auto begin = memory_->ticks.begin() + static_cast<std::ptrdiff_t>(first);
    return std::vector(begin, begin + static_cast<std::ptrdiff_t>(count));
  }
  const auto read_head = [&](const RecordingHead& now) -> Result<bool> {
    if (internal::same_run(now.header, head_.header) && now.ticks == count) return true;
    return internal::replaced(file_);
  };
  std::vector<TickRecord> ticks;
  const auto read_part = [&](const RecordingPart& part) -> Result<void> {
    ticks.insert(ticks.end(), part.ticks.begin(), part.ticks.end());
    return {};
  };
  const auto read = internal::read_beside_writer(file_, [&] {
    ticks.clear();
    return internal::read_isolated(file_, internal::RowRange{first, count}, read_head, read_part, progress);
  });
  if (!read) return read.error();
  return ticks;
}

Result<Recording> read_recording(const std::filesystem::path& file, const Progress& progress) {
  Recording recording;
  double all = 0;
  const auto read_head = [&](const RecordingHead& head) -> Result<bool> {
    recording.header = head.header;
    recording.summary = head.summary;
    all = static_cast<double>(head.ticks);
    return true;
  };
  // memory grows with the rows received, not with their announced number
  const auto read_part = [&](const RecordingPart& part) -> Result<void> {
    progress.report("reading the recording", static_cast<double>(recording.ticks.size()) / all);
    recording.ticks.insert(recording.ticks.end(), part.ticks.begin(), part.ticks.end());
    recording.events.insert(recording.events.end(), part.events.begin(), part.events.end());
    return {};
  };
  if (auto read = internal::read_isolated(file, std::nullopt, read_head, read_part, progress); !read)
    return read.error();
  return recording;
}

}  // namespace palpate
