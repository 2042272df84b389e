#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"
#include "palpate/device/registry.h"

/// What a machine lacks for a device that pushes, and what to do about it, for whoever looks after it.
namespace palpate {

enum class Finding : std::uint8_t {
  kFine,
  kAdvice,   ///< it works, and could be better
  kMissing,  ///< a device would not be felt, or not as it should be
};
/// "fine", "advice", "missing".
const char* name_of(Finding finding);

struct DoctorLine {
  std::string topic;  ///< "this computer", or a device's name
  std::string what;   ///< "real-time priority"
  Finding finding = Finding::kFine;
  std::string found;  ///< what is there, in words
  std::string cure;   ///< what to do; never empty where it is not fine
};

struct TimerFigures {
  double seconds = 0, rate_hz = 0;
  double p50_us = 0, p99_us = 0, max_us = 0;  ///< how late the timer was
  double on_time = 0;                         ///< part of all points in time that came within half a period
};

struct DoctorReport {
  std::vector<DoctorLine> lines;
  TimerFigures timer;
  bool missing() const;
};

struct DoctorSettings {
  double timer_s = 5;
  /// Names of devices that are to be there. Empty: whichever are; where one is ready, what others lack is
  /// advice.
  std::vector<std::string> devices = {};
  std::filesystem::path root = "/";  ///< where /proc and /sys are, for tests
};

/// Looks at scheduler, memory, processor, kernel, timer, and at each driver's library or service. Nothing is
/// moved, armed or changed. Takes timer_s and a few seconds.
/// Errors: kUsage for a device that is not known; kInterrupted; kUnavailable where no thread is to be had.
Result<DoctorReport> examine(const DeviceRegistry& known, const DoctorSettings& settings,
                             const Progress& progress = {});

}  // namespace palpate
