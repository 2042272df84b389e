#include "interleaved.h"

#include <time.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>

namespace palpate::bench {

namespace {

double process_cpu_ms() {
  timespec time{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return 1e3 * static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_nsec);
}

/// Wall-clock time, and CPU time of the process.
std::array<double, 2> elapsed_ms(const Contender& contender) {
  if (contender.before) contender.before();
  const double cpu = process_cpu_ms();
  const auto start = std::chrono::steady_clock::now();
  contender.work();
  const auto end = std::chrono::steady_clock::now();
  return {std::chrono::duration<double, std::milli>(end - start).count(), process_cpu_ms() - cpu};
}

void compare(const std::vector<float>& reference, const std::vector<float>& result, Timing& timing) {
  double sum = 0;
  for (std::size_t n = 0; n < reference.size(); ++n) {
    const double d = std::abs(static_cast<double>(reference[n]) - result.at(n));
    timing.max_difference = std::max(timing.max_difference, d);
    sum += d;
  }
  timing.mean_difference = sum / static_cast<double>(reference.size());
}

}  // namespace

std::vector<Timing> run_interleaved(const std::vector<Contender>& contenders,
                                    const std::vector<float>& reference, int rounds) {
  // results first; this also warms up caches
  std::vector<Timing> timings;
  for (const Contender& contender : contenders) {
    timings.emplace_back().name = contender.name;
    timings.back().threads = contender.threads;
    contender.work();
    compare(reference, contender.result(), timings.back());
  }

  std::vector<std::vector<double>> times(contenders.size()), cpu_times(contenders.size());
  for (int round = 0; round < rounds; ++round) {
    for (std::size_t c = 0; c < contenders.size(); ++c) {
      const auto [wall, cpu] = elapsed_ms(contenders[c]);
      times[c].push_back(wall);
      cpu_times[c].push_back(cpu);
    }
  }
  for (std::size_t c = 0; c < contenders.size(); ++c) {
    std::sort(times[c].begin(), times[c].end());
    std::sort(cpu_times[c].begin(), cpu_times[c].end());
    timings[c].cpu_ms = cpu_times[c][cpu_times[c].size() / 2];
    timings[c].median_ms = times[c][times[c].size() / 2];
    timings[c].fastest_ms = times[c].front();
    timings[c].slowest_ms = times[c].back();
  }
  for (Timing& timing : timings) {
    const auto base = std::find_if(timings.begin(), timings.end(),
                                   [&](const Timing& other) { return other.threads == timing.threads; });
    timing.ratio = timing.median_ms / base->median_ms;
  }
  return timings;
}

void print_table(const std::string& title, const std::vector<Timing>& timings) {
  std::printf("\n%s\n", title.c_str());
  std::printf("%-36s %7s %10s %10s %10s %10s %8s %12s %12s\n", "", "threads", "median ms", "fastest",
              "slowest", "CPU ms", "ratio", "max diff", "mean diff");
  for (const Timing& t : timings) {
    std::printf("%-36s %7d %10.2f %10.2f %10.2f %10.2f %8.1f %12.4f %12.6f\n", t.name.c_str(), t.threads,
                t.median_ms, t.fastest_ms, t.slowest_ms, t.cpu_ms, t.ratio, t.max_difference,
                t.mean_difference);
  }
}

}  // namespace palpate::bench
