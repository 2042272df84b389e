#include <atomic>
#include <cerrno>
#include <chrono>
#include <mutex>
#include <new>
#include <system_error>
#include <thread>

#include "palpate/base/check.h"
#include "palpate/base/file.h"
#include "palpate/base/spsc_ring.h"
#include "recording/recording_file.h"

namespace palpate {
namespace internal {
namespace {

// The servo may not wake another thread, so the ring is polled: at a period far below the seconds that it
// holds, and far above the cost of a poll.
constexpr std::chrono::milliseconds kPoll{5};
// ticks taken per batch: their slots are free again before the disk is accessed
constexpr std::size_t kBatch = 256;

class RingRecorder : public Recorder {
 public:
  RingRecorder(SpscRing<TickRecord>& ring, std::unique_ptr<RecordingWriter> writer,
               std::filesystem::path file, OnTick on_tick, EventLog* log)
      : ring_(ring),
        writer_(std::move(writer)),
        file_(std::move(file)),
        on_tick_(std::move(on_tick)),
        log_(log),
        batch_(kBatch) {}
  ~RingRecorder() override { stop(); }

  void start() {
    thread_ = std::thread([this] { run(); });
  }
  RecordingSummary so_far() const override {
    const std::lock_guard lock(mutex_);
    return summary_;
  }
  std::optional<Error> failure() const override {
    const std::lock_guard lock(mutex_);
    return failure_;
  }
  Result<RecordingSummary> finish(std::uint64_t dropped, std::uint64_t skipped,
                                  const std::vector<std::string>& problems) override;

 private:
  void run() noexcept;
  void stop();
  void drain();
  void take(std::span<const TickRecord> ticks);
  void move_acknowledged(const TickRecord& tick);
  Result<void> collect_events(std::span<const TickRecord> ticks);
  Result<void> write(std::span<const TickRecord> ticks);
  void abandon(const Error& error);

  // used by the recorder's thread, and by others after it has ended
  SpscRing<TickRecord>& ring_;
  std::unique_ptr<RecordingWriter> writer_;  // null: nothing is stored
  const std::filesystem::path file_;
  const OnTick on_tick_;
  EventLog* const log_;  // null: no external commands
  std::vector<TickRecord> batch_;
  std::list<RecordingEvent> pending_;   // events that no tick has acknowledged yet
  std::vector<RecordingEvent> events_;  // events of the batch

  std::thread thread_;
  std::atomic<bool> stop_ = false;
  mutable std::mutex mutex_;  // guards the members below; never held during a write
  RecordingSummary summary_;
  std::optional<Error> failure_;
};

void RingRecorder::run() noexcept {
  for (bool last = false; !last;) {
    // read before the ring is drained: ticks pushed before the stop are drained after it
    last = stop_.load(std::memory_order_acquire);
    drain();
    if (!last) std::this_thread::sleep_for(kPoll);
  }
}

void RingRecorder::stop() {
  stop_.store(true, std::memory_order_release);
  if (thread_.joinable()) thread_.join();
}

// drains the ring's current content; later ticks are left to the next call
void RingRecorder::drain() {
  for (std::size_t left = ring_.size(); left > 0;) {
    const std::size_t count = ring_.pop(std::span(batch_).first(std::min(left, batch_.size())));
    take(std::span(batch_).first(count));
    left -= count;
  }
}

void RingRecorder::take(std::span<const TickRecord> ticks) {
  {
    const std::lock_guard lock(mutex_);
    for (const TickRecord& tick : ticks) summary_.observe(tick);
  }
  const Result<void> collected = collect_events(ticks);
  auto row = events_.cbegin();
  for (const TickRecord& tick : ticks) {
    const auto first = row;
    while (row != events_.cend() && row->tick == tick.tick) ++row;
    if (on_tick_) on_tick_(tick, {first, row});
  }
  const Result<void> written = collected ? write(ticks) : collected;
  if (!written) abandon(written.error());
}

bool acknowledges(const TickRecord& tick, const RecordingEvent& event) {
  switch (event.kind) {
    case RecordingEvent::Kind::kModel:
    case RecordingEvent::Kind::kSweep:
      return tick.model_version >= event.number;
    case RecordingEvent::Kind::kSettings:
      return tick.settings_number >= event.number;
    case RecordingEvent::Kind::kTissueSolution:
      return tick.solver_frame >= event.number;
    case RecordingEvent::Kind::kStop:
    case RecordingEvent::Kind::kRearm:
      break;
  }
  return tick.arming_number >= event.number;
}

// moves the events that this tick is the first to acknowledge
void RingRecorder::move_acknowledged(const TickRecord& tick) {
  for (auto row = pending_.begin(); row != pending_.end();) {
    if (!acknowledges(tick, *row)) {
      ++row;
      continue;
    }
    row->tick = tick.tick;
    events_.push_back(*row);
    row = pending_.erase(row);
  }
}

// called after the ticks were popped, so that all events that they acknowledge are available
Result<void> RingRecorder::collect_events(std::span<const TickRecord> ticks) {
  events_.clear();
  try {
    if (log_ != nullptr) log_->take(pending_);
    for (const TickRecord& tick : ticks) move_acknowledged(tick);
    return {};
  } catch (const std::bad_alloc&) {
    return output_error(file_, ENOMEM);
  }
}

Result<void> RingRecorder::write(std::span<const TickRecord> ticks) {
  try {
    return writer_ ? writer_->append(ticks, events_) : Result<void>();
  } catch (const std::bad_alloc&) {
    return output_error(file_, ENOMEM);
  }
}

void RingRecorder::abandon(const Error& error) {
  // closes the file, which retains what was flushed
  writer_.reset();
  const std::lock_guard lock(mutex_);
  failure_ = error;
}

Result<RecordingSummary> RingRecorder::finish(std::uint64_t dropped, std::uint64_t skipped,
                                              const std::vector<std::string>& problems) {
  PALPATE_CHECK(thread_.joinable());
  stop();
  if (failure_) return *failure_;
  RecordingSummary summary = so_far();
  summary.dropped = dropped;
  summary.skipped = skipped;
  summary.problems = problems;
  if (writer_) {
    if (auto finished = writer_->finish(summary); !finished) {
      abandon(finished.error());
      return finished.error();
    }
    writer_.reset();
  }
  const std::lock_guard lock(mutex_);
  summary_ = summary;
  return summary;
}

}  // namespace

Result<std::unique_ptr<Recorder>> start_recorder(SpscRing<TickRecord>& ring,
                                                 std::unique_ptr<RecordingWriter> writer,
                                                 const std::filesystem::path& file, Recorder::OnTick on_tick,
                                                 EventLog* log) {
  auto recorder = std::make_unique<RingRecorder>(ring, std::move(writer), file, std::move(on_tick), log);
  try {
    recorder->start();
  } catch (const std::system_error& refused) {
    return Error{ErrorKind::kUnavailable,
                 std::string("cannot start the recorder's thread: ") + refused.what(), "",
                 "close other programs, or raise the process limit (ulimit -u)"};
  }
  return std::unique_ptr<Recorder>(std::move(recorder));
}

}  // namespace internal

Result<std::unique_ptr<Recorder>> Recorder::start(SpscRing<TickRecord>& ring,
                                                  const std::filesystem::path& file,
                                                  const RecordingHeader& header, OnTick on_tick,
                                                  EventLog* log) {
  std::unique_ptr<RecordingWriter> writer;
  if (!file.empty()) {
    auto created = RecordingWriter::create(file, header);
    if (!created) return created.error();
    writer = std::move(*created);
  }
  return internal::start_recorder(ring, std::move(writer), file, std::move(on_tick), log);
}

}  // namespace palpate
