#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"
#include "palpate/device/registry.h"

/// Diagnosis of a machine for haptic devices with force feedback, with remedies for its administrator.
namespace palpate {

/// Severity of a line of the report.
enum class Finding : std::uint8_t {
  kFine,
  kAdvice,   ///< Usable, but could be improved
  kMissing,  ///< Forces would be missing or degraded
};
/// "fine", "advice", "missing".
const char* name_of(Finding finding);

/// One line of the report.
struct DoctorLine {
  std::string topic;  ///< Subject: "this computer", or the name of a device
  std::string what;   ///< Item, e.g. "real-time priority"
  Finding finding = Finding::kFine;
  std::string found;   ///< Description of the current state
  std::string remedy;  ///< Remedy; not empty unless the finding is kFine
};

/// Timing of a periodic timer on this machine.
struct TimerFigures {
  double seconds = 0, rate_hz = 0;
  double p50_us = 0, p99_us = 0, max_us = 0;  ///< Percentiles of the timer's lateness
  double on_time = 0;                         ///< Fraction of ticks that were less than half a period late
};

/// Result of examine().
struct DoctorReport {
  std::vector<DoctorLine> lines;
  TimerFigures timer;
  bool missing() const;
};

/// Parameters of examine().
struct DoctorSettings {
  /// Duration of the timer measurement.
  double timer_s = 5;
  /// Names of required devices. Empty: any; if one is ready, missing parts of the others are reported as
  /// advice.
  std::vector<std::string> devices = {};
  std::filesystem::path root = "/";  ///< Root of /proc and /sys, for tests
};

/// Checks scheduling rights, memory locking, processor, kernel, timer, and the library or service of each
/// driver. No device is moved or armed, and no setting is changed. Takes timer_s plus a few seconds. Errors:
/// kUsage for an unknown device; kInterrupted; kUnavailable if no thread can be started.
Result<DoctorReport> examine(const DeviceRegistry& known, const DoctorSettings& settings,
                             const Progress& progress = {});

}  // namespace palpate
