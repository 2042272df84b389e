#pragma once

#include <atomic>

#include "palpate/recording/event_log.h"
#include "palpate/servo/servo_loop.h"

namespace palpate {

/// Servo loop of a session, as its parts reach it, and the log of all commands passed to it. Thread-safe.
class SessionLoop {
 public:
  /// Null until the session begins, and after it has ended.
  ServoLoop* get() const { return loop_.load(); }
  void connect(ServoLoop& loop) { loop_.store(&loop); }
  void disconnect() { loop_.store(nullptr); }
  /// Every command with its originator, for the recorder.
  EventLog& log() { return log_; }

 private:
  std::atomic<ServoLoop*> loop_{nullptr};
  EventLog log_;
};

}  // namespace palpate
