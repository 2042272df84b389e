#include "palpate/doctor/doctor.h"

#include <pwd.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <future>
#include <system_error>
#include <thread>

#include "doctor/machine.h"
#include "palpate/base/latency_histogram.h"
#include "palpate/servo/empty_loop.h"

namespace palpate {
namespace {

constexpr double kTimerRate_hz = 1000;
constexpr int kHighestRequested = 95;

std::string user_name() {
  const passwd* entry = ::getpwuid(::getuid());
  return entry && entry->pw_name ? entry->pw_name : "";
}

// requests all rights of a session for a thread
Result<RealtimeGrant> try_rights() try {
  return std::async(
             std::launch::async,
             [] {
               return make_this_thread_realtime({.priority = kHighestRequested, .name = "palpate-doctor"});
             })
      .get();
} catch (const std::system_error& error) {
  return Error{ErrorKind::kUnavailable, std::string("cannot start a thread: ") + error.what(), "",
               "close other programs, or raise the process limit (ulimit -u)"};
}

Result<TimerFigures> measure_timer(double seconds, const Progress& progress) {
  LatencyHistogram lateness;
  progress.report("measuring the clock", 0);
  const auto loop = measure_empty_loop(kTimerRate_hz, seconds, 0, {}, lateness, progress);
  if (!loop) return loop.error();
  progress.report("measuring the clock", 1);
  const auto late = lateness.summary();
  const std::int64_t half_period_ns = std::llround(0.5e9 / kTimerRate_hz);
  const double points = static_cast<double>(loop->ticks + loop->skipped);
  const double in_time = static_cast<double>(loop->ticks) * lateness.fraction_at_most(half_period_ns);
  return TimerFigures{seconds,     kTimerRate_hz, late.p50_us,
                      late.p99_us, late.max_us,   points > 0 ? in_time / points : 0};
}

void detect_devices(const DeviceRegistry& known, const DoctorSettings& settings, DoctorReport& report) {
  const std::size_t before = report.lines.size();
  bool any_ready = false;
  for (const DeviceVendor& vendor : known.all()) {
    const bool requested = std::ranges::find(settings.devices, vendor.name) != settings.devices.end();
    if (!settings.devices.empty() && !requested) continue;
    const DeviceReport device = vendor.detect();
    bool fine = !device.connected.empty();
    for (const DeviceCheck& check : device.checks) {
      fine = fine && check.passed;
      report.lines.push_back({vendor.name, check.what, check.passed ? Finding::kFine : Finding::kMissing,
                              check.found, check.passed ? "" : check.remedy});
    }
    any_ready = any_ready || fine;
  }
  // with one device ready, the requirements of others are only advice
  if (any_ready && settings.devices.empty())
    for (auto line = report.lines.begin() + static_cast<std::ptrdiff_t>(before); line != report.lines.end();
         ++line)
      if (line->finding == Finding::kMissing) line->finding = Finding::kAdvice;
}

}  // namespace

const char* name_of(Finding finding) {
  switch (finding) {
    case Finding::kAdvice:
      return "advice";
    case Finding::kMissing:
      return "missing";
    case Finding::kFine:
      break;
  }
  return "fine";
}

bool DoctorReport::missing() const {
  return std::ranges::any_of(lines, [](const DoctorLine& line) { return line.finding == Finding::kMissing; });
}

Result<DoctorReport> examine(const DeviceRegistry& known, const DoctorSettings& settings,
                             const Progress& progress) {
  for (const std::string& name : settings.devices)
    if (!known.find(name)) {
      std::string all;
      for (const DeviceVendor& vendor : known.all()) all += (all.empty() ? "" : ", ") + vendor.name;
      return Error{ErrorKind::kUsage, "no device '" + name + "' is known", "--device", "there are: " + all};
    }
  DoctorReport report;
  const auto grant = try_rights();
  if (!grant) return grant.error();
  const std::string user = user_name();
  report.lines = {priority_line(*grant, user), memory_line(*grant, user), governor_line(settings.root),
                  kernel_line(settings.root)};
  // the same lines of limits.conf give both rights
  if (report.lines[0].finding == Finding::kMissing && !report.lines[1].remedy.empty())
    report.lines[1].remedy =
        "the three lines above, for the priority, also grant this: nothing more to enter";
  const auto timer = measure_timer(settings.timer_s, progress);
  if (!timer) return timer.error();
  report.timer = *timer;
  report.lines.push_back(timer_line(*timer, grant->fifo));
  progress.report("looking for devices", 0);
  detect_devices(known, settings, report);
  progress.report("looking for devices", 1);
  return report;
}

}  // namespace palpate
