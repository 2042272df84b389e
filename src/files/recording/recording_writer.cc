#include <fcntl.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <optional>

#include "palpate/base/check.h"
#include "palpate/base/file.h"
#include "palpate/device/device.h"
#include "recording/columns.h"
#include "recording/commit_driver.h"
#include "recording/growing_table.h"
#include "recording/hdf5_writing.h"
#include "recording/header_fields.h"
#include "recording/recording_file.h"

namespace palpate {
namespace internal {
namespace {

// A commit is due after a second. Chunks are filled in slightly less time, even if the clock is somewhat
// slow, so that commits write complete chunks once.
constexpr double kMaxUnflushed_s = 1.0;
constexpr double kChunk_s = 0.8;
constexpr double kMaxChunkRows = 65536;
// A partial chunk is written again with each flush and its old space is lost, so event chunks are small.
constexpr std::size_t kEventChunkRows = 64;

std::size_t chunk_rows_at(double rate_hz) {
  return static_cast<std::size_t>(std::clamp(std::floor(kChunk_s * rate_hz), 1.0, kMaxChunkRows));
}

// truncates a text at a UTF-8 character boundary if it is too long; zero bytes are removed because they would
// terminate it
std::string truncated(std::string text, std::size_t largest) {
  std::erase(text, '\0');
  if (text.size() <= largest) return text;
  constexpr std::string_view kMore = "...";
  std::size_t end = largest - kMore.size();
  while (end > 0 && (static_cast<unsigned char>(text[end]) & 0xc0) == 0x80) --end;
  return text.substr(0, end).append(kMore);
}

// truncates the list and its sentences to the limits of a recording
std::vector<std::string> stored_problems(const std::vector<std::string>& problems) {
  std::vector<std::string> stored;
  for (const std::string& sentence : problems) {
    if (stored.size() + 1 == kMaxProblems && problems.size() > kMaxProblems) {
      stored.push_back("and " + std::to_string(problems.size() - stored.size()) + " more");
      break;
    }
    stored.push_back(truncated(sentence, kProblemBytes));
  }
  return stored;
}

class Hdf5Writer : public RecordingWriter {
 public:
  Hdf5Writer(std::unique_ptr<ByteSink> sink, const RecordingHeader& header, std::filesystem::path file)
      : name_(std::move(file)),
        bytes_(std::move(sink)),
        devices_(header.devices),
        ticks_(chunk_rows_at(header.rate_hz)) {}
  ~Hdf5Writer() override {
    // an unfinished run still stores every tick that was appended
    const Hdf5Section section;
    if (file_.ok() && bytes_.error() == 0) static_cast<void>(flush());
    close();
  }

  Result<void> start(const RecordingHeader& header);
  Result<void> append(std::span<const TickRecord> ticks, std::span<const RecordingEvent> events) override;
  Result<void> finish(const RecordingSummary& summary) override;

 private:
  bool write_fixed_part(const RecordingHeader& header);
  bool write_summary(const RecordingSummary& summary);
  void write_structures(ObjectWriter& writer, const std::vector<RecordingHeader::Structure>& structures);
  Result<void> flush();
  Result<void> commit_rows(GrowingTable& table);
  void close();
  Error failure() const;

  std::filesystem::path name_;
  CommitFile bytes_;
  int devices_;
  Handle file_;
  GrowingTable ticks_, events_{kEventChunkRows};
  Handle problems_;
  double unflushed_since_s_ = 0;  // time of the first tick not flushed yet
  bool finished_ = false;
};

Error Hdf5Writer::failure() const {
  Error error = output_error(name_, bytes_.error() != 0 ? bytes_.error() : EIO);
  if (ticks_.flushed_rows() > 0)
    error.remedy += (error.remedy.empty() ? "" : "; ") + std::string("the first ") +
                    std::to_string(ticks_.flushed_rows()) + " ticks are kept";
  return error;
}

Result<void> Hdf5Writer::start(const RecordingHeader& header) {
  const Hdf5Section section;
  Handle access = access_through(bytes_);
  Handle creation(H5Pcreate(H5P_FILE_CREATE), H5Pclose);
  // A superblock of version 2 has no "open for writing" mark that a killed process would leave behind;
  // without free-space managers nothing that the committed file refers to is ever overwritten.
  const bool made =
      access.ok() && H5Pset_libver_bounds(access.get(), H5F_LIBVER_V18, H5F_LIBVER_LATEST) >= 0 &&
      H5Pset_file_space_strategy(creation.get(), H5F_FSPACE_STRATEGY_NONE, false, 1) >= 0 &&
      H5Pset_obj_track_times(creation.get(), false) >= 0 &&
      (file_ = Handle(H5Fcreate("recording", H5F_ACC_TRUNC, creation.get(), access.get()), H5Fclose)).ok() &&
      // data sets of version 1.10, whose chunk index is append-only
      H5Fset_libver_bounds(file_.get(), H5F_LIBVER_V110, H5F_LIBVER_LATEST) >= 0 &&
      write_fixed_part(header) && commit(file_, bytes_);
  if (!made) return failure();
  return {};
}

bool Hdf5Writer::write_fixed_part(const RecordingHeader& header) {
  ObjectWriter writer(file_.get());
  writer.attribute(file_.get(), "format", kFormat, H5T_CSET_ASCII);
  writer.attribute(file_.get(), "format_major", kFormatMajor);
  writer.attribute(file_.get(), "format_minor", kFormatMinor);

  const Handle header_group = writer.group("header");
  visit_header(header, [&](const char* name, const auto& value) {
    writer.attribute(header_group.get(), name, value);
  });
  const Handle script_type = fixed_text_type(header.script_text.size(), H5T_CSET_UTF8);
  writer.data_set(header_group.get(), "script", script_type.get(), {}, header.script_text.c_str());
  write_structures(writer, header.structures);

  // zeros and no sentences until finish(), which then creates no new object
  const Handle summary = writer.group("summary");
  const std::uint64_t zero = 0;
  const RecordingSummary unknown;
  visit_summary(unknown, [&](const char* name, std::uint64_t) {
    writer.data_set(summary.get(), name, H5T_STD_U64LE, {}, &zero);
  });
  writer.data_set(summary.get(), "complete", H5T_STD_U8LE, {}, &zero);
  constexpr hsize_t kProblemChunk = 16;
  problems_ = writer.extensible_data_set(
      summary.get(), "trouble", fixed_text_type(kProblemBytes, H5T_CSET_UTF8).get(), 1, kProblemChunk);

  ticks_.add(writer, "ticks", tick_columns());
  for (int d = 0; d < devices_; ++d)
    ticks_.add(writer, ("device" + std::to_string(d)).c_str(), device_columns());
  events_.add(writer, "events", event_columns());
  return writer.ok();
}

void Hdf5Writer::write_structures(ObjectWriter& writer,
                                  const std::vector<RecordingHeader::Structure>& structures) {
  const Handle group = writer.group("structures");
  const hsize_t count = structures.size();
  std::vector<LabelId> labels;
  std::vector<Rgb> colours;
  for (const auto& structure : structures) {
    labels.push_back(structure.label);
    colours.push_back(structure.colour);
  }
  static_assert(sizeof(Rgb) == 3);
  writer.data_set(group.get(), "label", H5T_STD_U16LE, {count}, labels.data());
  writer.data_set(group.get(), "colour", H5T_STD_U8LE, {count, 3}, colours.data());

  const auto texts = [&](const char* name, std::string RecordingHeader::Structure::*text) {
    std::vector<std::string> values;
    for (const auto& structure : structures) values.push_back(structure.*text);
    std::size_t width = 1;
    for (const std::string& value : values) width = std::max(width, value.size());
    const Handle type = fixed_text_type(width, H5T_CSET_UTF8);
    writer.data_set(group.get(), name, type.get(), {count}, padded(values, width).data());
  };
  texts("name", &RecordingHeader::Structure::name);
  texts("tissue", &RecordingHeader::Structure::tissue);
}

Result<void> Hdf5Writer::append(std::span<const TickRecord> ticks, std::span<const RecordingEvent> events) {
  PALPATE_CHECK(!finished_);
  if (bytes_.error() != 0) return failure();
  const Hdf5Section section;
  // events precede the ticks that acknowledge them
  for (const RecordingEvent& event : events) {
    events_.put(0, event_columns(), &event);
    events_.next_row();
    if (!events_.full()) continue;
    if (auto committed = commit_rows(events_); !committed) return committed;
  }
  for (const TickRecord& tick : ticks) {
    PALPATE_CHECK(tick.devices == devices_);
    if (ticks_.all_flushed()) unflushed_since_s_ = tick.time_s;
    std::size_t column = ticks_.put(0, tick_columns(), &tick);
    for (int d = 0; d < devices_; ++d)
      column = ticks_.put(column, device_columns(), &tick.device[static_cast<std::size_t>(d)]);
    ticks_.next_row();
    const bool due = ticks_.full() || tick.time_s - unflushed_since_s_ >= kMaxUnflushed_s;
    if (!due) continue;
    if (auto flushed = flush(); !flushed) return flushed;
  }
  return {};
}

// Events get a separate commit first: at no time does the file contain a tick without the events that it
// acknowledges.
Result<void> Hdf5Writer::flush() {
  if (auto committed = commit_rows(events_); !committed) return committed;
  return commit_rows(ticks_);
}

Result<void> Hdf5Writer::commit_rows(GrowingTable& table) {
  if (table.all_flushed()) return {};
  if (!table.flush(bytes_) || !commit(file_, bytes_)) {
    bytes_.fail(EIO);
    return failure();
  }
  table.committed();
  return {};
}

bool Hdf5Writer::write_summary(const RecordingSummary& summary) {
  const auto put = [&](const std::string& name, hid_t type, const void* value) {
    const Handle data_set(H5Dopen2(file_.get(), ("summary/" + name).c_str(), H5P_DEFAULT), H5Dclose);
    return H5Dwrite(data_set.get(), type, H5S_ALL, H5S_ALL, H5P_DEFAULT, value) >= 0;
  };
  bool written = true;
  visit_summary(summary, [&](const char* name, std::uint64_t value) {
    written = written && put(name, H5T_STD_U64LE, &value);
  });
  if (const auto sentences = stored_problems(summary.problems); !sentences.empty()) {
    const Handle type = fixed_text_type(kProblemBytes, H5T_CSET_UTF8);
    written = written && append_rows(problems_, type.get(), 1, 0, sentences.size(),
                                     padded(sentences, kProblemBytes).data());
  }
  // the completion mark is committed after everything that it covers
  const std::uint8_t complete = 1;
  return written && commit(file_, bytes_) && put("complete", H5T_STD_U8LE, &complete) &&
         commit(file_, bytes_);
}

Result<void> Hdf5Writer::finish(const RecordingSummary& summary) {
  PALPATE_CHECK(!finished_);
  if (bytes_.error() != 0) return failure();
  const Hdf5Section section;
  if (auto flushed = flush(); !flushed) return flushed;
  if (!write_summary(summary)) {
    bytes_.fail(EIO);
    return failure();
  }
  finished_ = true;
  close();
  if (bytes_.error() != 0) return failure();
  return {};
}

void Hdf5Writer::close() {
  if (!file_.ok()) return;
  bytes_.seal();
  ticks_.close();
  events_.close();
  problems_.reset();
  file_.reset();
  bytes_.trim_and_sync();
}

std::optional<Error> header_error(const RecordingHeader& header) {
  const auto bad = [](std::string what) { return Error{ErrorKind::kBadInput, std::move(what), "", ""}; };
  if (header.devices < 1 || header.devices > kMaxDevices)
    return bad("a recording holds 1 to " + std::to_string(kMaxDevices) + " devices, not " +
               std::to_string(header.devices));
  if (!std::isfinite(header.rate_hz) || header.rate_hz <= 0)
    return bad("the rate of a recording must be finite and above 0 Hz");
  if (header.clock != kVirtualClock && header.clock != kRealClock)
    return bad("the clock of a recording is virtual or real");
  if (header.structures.size() > kMaxStructures)
    return bad("more than " + std::to_string(kMaxStructures) + " structures do not fit a recording");

  // texts must survive a round trip
  std::optional<Error> error;
  const auto check = [&](const std::string& name, const std::string& text, std::size_t largest) {
    if (text.size() > largest)
      error = bad("the " + name + " is longer than " + std::to_string(largest) + " bytes");
    if (text.find('\0') != std::string::npos) error = bad("the " + name + " contains a zero byte");
  };
  visit_header(header, [&](const char* name, const auto& value) {
    if constexpr (std::is_same_v<std::decay_t<decltype(value)>, std::string>) check(name, value, kMaxText);
  });
  check("script", header.script_text, kMaxScript);
  std::size_t names = 0;
  for (const auto& structure : header.structures) {
    check("name of a structure", structure.name, kMaxText);
    check("tissue of a structure", structure.tissue, kMaxText);
    names += structure.name.size() + structure.tissue.size();
  }
  if (names > kMaxNames) error = bad("the names of the structures are longer than 64 MiB");
  return error;
}

}  // namespace

Result<std::unique_ptr<RecordingWriter>> create_on(std::unique_ptr<ByteSink> sink,
                                                   const RecordingHeader& header,
                                                   const std::filesystem::path& file) {
  if (auto error = header_error(header)) {
    error->where = file.string();
    return *error;
  }
  auto writer = std::make_unique<Hdf5Writer>(std::move(sink), header, file);
  if (auto started = writer->start(header); !started) return started.error();
  return std::unique_ptr<RecordingWriter>(std::move(writer));
}

}  // namespace internal

Result<std::unique_ptr<RecordingWriter>> RecordingWriter::create(const std::filesystem::path& file,
                                                                 const RecordingHeader& header) {
  // the file gets its final name once it contains a valid recording
  auto claim = OutputClaim::take(file);
  if (!claim) return claim.error();
  auto pending = PendingFile::create(file);
  if (!pending) return pending.error();
  const int descriptor = ::open(pending->path().c_str(), O_RDWR | O_CLOEXEC);
  if (descriptor < 0) return output_error(file, errno);
  auto writer = internal::create_on(internal::make_file_sink(descriptor, *std::move(claim)), header, file);
  if (!writer) return writer;
  if (auto committed = pending->commit(); !committed) return committed.error();
  return writer;
}

}  // namespace palpate
