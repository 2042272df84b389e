#include "servo/thread_monitor.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>

namespace palpate {
namespace {

// /proc/stat has a line per CPU, so its size grows with the machine
constexpr std::size_t kText_bytes = 64 << 10;

int open_file(const std::string& name) {
  return ::open(name.c_str(), O_RDONLY | O_CLOEXEC);
}

std::string task_file(pid_t tid, const char* name) {
  return "/proc/self/task/" + std::to_string(tid) + "/" + name;
}

// the word at `index`, counted from 0, as a number; empty if it is not a number
std::optional<std::uint64_t> number_at(std::string_view text, int index) {
  constexpr std::string_view kBlank = " \t";
  for (;; --index) {
    text.remove_prefix(std::min(text.find_first_not_of(kBlank), text.size()));
    if (index == 0) break;
    text.remove_prefix(std::min(text.find_first_of(kBlank), text.size()));
  }
  std::uint64_t number = 0;
  if (std::from_chars(text.data(), text.data() + text.size(), number).ec != std::errc()) return {};
  return number;
}

// rest of the line that begins with `key`
std::string_view line_after(std::string_view text, std::string_view key) {
  while (!text.empty()) {
    const std::string_view line = text.substr(0, text.find('\n'));
    if (line.starts_with(key)) return line.substr(key.size());
    text.remove_prefix(std::min(line.size() + 1, text.size()));
  }
  return {};
}

bool grew(const std::optional<std::uint64_t>& before, const std::optional<std::uint64_t>& after) {
  return before && after && *after > *before;
}

}  // namespace

ThreadMonitor::ThreadMonitor(pid_t tid)
    : status_(open_file(task_file(tid, "status"))),
      stat_(open_file(task_file(tid, "stat"))),
      schedstat_(open_file(task_file(tid, "schedstat"))),
      machine_stat_(open_file("/proc/stat")),
      buffer_(kText_bytes) {}

ThreadMonitor::~ThreadMonitor() {
  for (const int file : {status_, stat_, schedstat_, machine_stat_})
    if (file >= 0) ::close(file);
}

std::string_view ThreadMonitor::text_of(int file) {
  if (file < 0) return {};
  const ssize_t size = ::pread(file, buffer_.data(), buffer_.size(), 0);
  return size > 0 ? std::string_view(buffer_.data(), static_cast<std::size_t>(size)) : std::string_view();
}

ThreadMonitor::Counters ThreadMonitor::read() {
  Counters counters;
  counters.involuntary_switches = number_at(line_after(text_of(status_), "nonvoluntary_ctxt_switches:"), 0);
  counters.run_delay_ns = number_at(text_of(schedstat_), 1);

  // proc(5) counts fields from 1; the third is the first after the name, which may hold blanks and brackets
  std::string_view stat = text_of(stat_);
  stat.remove_prefix(std::min(stat.rfind(')'), stat.size()));
  if (!stat.empty()) {
    stat.remove_prefix(1);
    counters.minor_faults = number_at(stat, 10 - 3);
    counters.major_faults = number_at(stat, 12 - 3);
    if (const auto cpu = number_at(stat, 39 - 3)) counters.cpu = static_cast<int>(*cpu);
  }

  // user nice system idle iowait irq softirq steal
  const std::string_view machine = text_of(machine_stat_);
  counters.all_steal_ticks = number_at(line_after(machine, "cpu "), 7);
  if (counters.cpu)
    counters.cpu_steal_ticks = number_at(line_after(machine, "cpu" + std::to_string(*counters.cpu) + " "), 7);
  return counters;
}

LateCause late_cause(const ThreadMonitor::Counters& before, const ThreadMonitor::Counters& after,
                     std::int64_t late_ns) {
  const bool stayed = before.cpu && before.cpu == after.cpu;
  if (stayed ? grew(before.cpu_steal_ticks, after.cpu_steal_ticks)
             : grew(before.all_steal_ticks, after.all_steal_ticks))
    return LateCause::kSteal;
  if (grew(before.minor_faults, after.minor_faults) || grew(before.major_faults, after.major_faults))
    return LateCause::kPageFault;
  if (grew(before.involuntary_switches, after.involuntary_switches)) return LateCause::kPreemption;
  if (grew(before.run_delay_ns, after.run_delay_ns) &&
      static_cast<double>(*after.run_delay_ns - *before.run_delay_ns) >= 0.5 * static_cast<double>(late_ns))
    return LateCause::kRunQueue;
  return LateCause::kUnknown;
}

std::string name_of(LateCause cause) {
  switch (cause) {
    case LateCause::kSteal:
      return "steal";
    case LateCause::kPageFault:
      return "page fault";
    case LateCause::kPreemption:
      return "pre-emption";
    case LateCause::kRunQueue:
      return "run queue";
    case LateCause::kUnknown:
      break;
  }
  return "unknown";
}

}  // namespace palpate
