#include "palpate/recording/event_log.h"
#include "palpate/recording/recording.h"

namespace palpate {

void EventLog::append(const std::function<std::optional<RecordingEvent>()>& apply) {
  // allocate first, so that the event of a command that was carried out cannot be lost
  std::list<RecordingEvent> row(1);
  std::list<std::uint64_t> announcement(1);
  struct Announced {
    EventLog& log;
    const std::list<std::uint64_t>::iterator own;
    ~Announced() {
      {
        const std::lock_guard lock(log.mutex_);
        log.announced_.erase(own);
      }
      log.over_.notify_all();
    }
  } const announced{*this, announcement.begin()};
  {
    const std::lock_guard lock(mutex_);
    announcement.front() = announcements_++;
    announced_.splice(announced_.end(), announcement);
  }

  const auto done = apply();
  if (!done) return;
  row.front() = *done;
  // stored before the announcement is over
  const std::lock_guard lock(mutex_);
  rows_.splice(rows_.end(), row);
}

void EventLog::take(std::list<RecordingEvent>& rows) {
  std::unique_lock lock(mutex_);
  const std::uint64_t later = announcements_;
  over_.wait(lock, [&] { return announced_.empty() || announced_.front() >= later; });
  rows.splice(rows.end(), rows_);
}

}  // namespace palpate
