#include "doctor/machine.h"

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <map>

namespace palpate {
namespace {

constexpr const char* kComputer = "this computer";
// priority of the supervisor, the highest that is requested
constexpr int kMaxPriority = 95;
// minimum fraction of punctual ticks; below it the timer is perceived as roughness
constexpr double kMinOnTime = 0.99;

// first line of a small kernel file; empty if missing
std::string line_of(const std::filesystem::path& file) {
  std::ifstream in(file);
  std::string line;
  std::getline(in, line);
  return line;
}

std::string account_name(const std::string& user) {
  return user.empty() ? "NAME (the account that palpate is started from)" : user;
}

// the same for both rights, which are configured in one file
std::string rights_remedy(const std::string& user) {
  return "an administrator enters these three lines in a terminal, once:\n"
         "  sudo groupadd -f haptics\n"
         "  sudo usermod -aG haptics " +
         account_name(user) +
         "\n"
         "  printf '@haptics - rtprio 95\\n@haptics - memlock unlimited\\n' | sudo tee "
         "/etc/security/limits.d/palpate.conf\n"
         "then log out and in again (or restart the computer), and run palpate doctor once more";
}

}  // namespace

DoctorLine priority_line(const RealtimeGrant& grant, const std::string& user) {
  DoctorLine line{kComputer, "priority over other programs", Finding::kFine, grant.scheduler, ""};
  if (grant.fifo && grant.priority >= kMaxPriority) {
    line.found = "granted (" + grant.scheduler + ")";
    return line;
  }
  line.finding = Finding::kMissing;
  line.found = grant.fifo ? "granted in part only (" + grant.scheduler + ")"
                          : "this account may not use it, so other programs can delay the force (" +
                                grant.scheduler + ")";
  line.remedy = rights_remedy(user);
  return line;
}

DoctorLine memory_line(const RealtimeGrant& grant, const std::string& user) {
  DoctorLine line{kComputer, "locked memory", Finding::kFine, grant.memory, ""};
  if (grant.memory_locked && grant.memory == "locked") {
    line.found = "granted";
    return line;
  }
  line.finding = grant.memory_locked ? Finding::kAdvice : Finding::kMissing;
  line.found = (grant.memory_locked ? "granted in part only (" : "this account may not lock its memory (") +
               grant.memory + ")";
  line.remedy = rights_remedy(user);
  return line;
}

DoctorLine governor_line(const std::filesystem::path& root) {
  DoctorLine line{kComputer, "processor speed", Finding::kFine, "", ""};
  std::map<std::string, int> governors;
  std::error_code none;
  for (const auto& cpu : std::filesystem::directory_iterator(root / "sys/devices/system/cpu", none))
    if (const std::string governor = line_of(cpu.path() / "cpufreq/scaling_governor"); !governor.empty())
      ++governors[governor];
  if (governors.empty()) {
    line.found = "not controlled by programs here, as in most virtual machines: nothing to do";
    return line;
  }
  for (const auto& [governor, count] : governors)
    line.found += (line.found.empty() ? "" : ", ") + std::string("'") + governor + "' on " +
                  std::to_string(count) + (count == 1 ? " core" : " cores");
  if (governors.size() == 1 && governors.contains("performance")) return line;
  line.finding = Finding::kAdvice;
  line.found += ": cores that slow down to save power wake up late";
  line.remedy =
      "before a session an administrator enters: sudo cpupower frequency-set -g performance (to install the "
      "program: sudo apt install linux-cpupower)";
  return line;
}

DoctorLine kernel_line(const std::filesystem::path& root) {
  const std::string version = line_of(root / "proc/sys/kernel/version");
  DoctorLine line{kComputer, "kernel", Finding::kFine, line_of(root / "proc/sys/kernel/osrelease"), ""};
  if (line.found.empty()) line.found = "unknown";
  const bool realtime =
      line_of(root / "sys/kernel/realtime") == "1" || version.find("PREEMPT_RT") != std::string::npos;
  line.found += realtime ? ", real-time" : ", not real-time";
  if (realtime) return line;
  line.finding = Finding::kAdvice;
  line.remedy =
      "it works; if forces feel rough at times, a real-time kernel helps: sudo apt install "
      "linux-image-rt-amd64, then restart the computer";
  return line;
}

DoctorLine timer_line(const TimerFigures& timer, bool realtime) {
  char text[260];
  std::snprintf(text, sizeof text,
                "%.2f %% of the ticks were on time (%.0f per second, measured for %.1f s); lateness: median "
                "%.0f microseconds, 99th percentile %.0f, maximum %.0f",
                100 * timer.on_time, timer.rate_hz, timer.seconds, timer.p50_us, timer.p99_us, timer.max_us);
  DoctorLine line{kComputer, "punctuality", Finding::kFine, text, ""};
  if (timer.on_time >= kMinOnTime) return line;
  line.finding = Finding::kMissing;
  line.remedy = realtime
                    ? "close other programs, and check whether this is a virtual machine: use a physical "
                      "computer for a device"
                    : "first grant the account its permissions (above), close other programs, and try again";
  return line;
}

}  // namespace palpate
