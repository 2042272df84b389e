#include "explore_result.h"

#include <algorithm>
#include <cstdio>
#include <utility>

#include "palpate/server/viewer_server.h"
#include "scene_options.h"
#include "scoring.h"
#include "verb.h"

namespace palpate::app {
namespace {

void print_row(const char* name, const Percentiles& p) {
  std::printf("%-28s %8.1f %8.1f %8.1f %8.1f\n", name, p.p50_us, p.p99_us, p.p999_us, p.max_us);
}

unsigned long long u(std::uint64_t count) {
  return count;
}

void print_loop(const LoopHealth& health, const std::vector<TickingThread>& threads) {
  std::printf("\n%-28s %8s %8s %8s %8s\n", "servo", "p50", "p99", "p99.9", "max");
  print_row("lateness us", health.lateness);
  print_row("compute us", health.compute);
  std::printf("%llu ticks, %.2f a second, %.2f %% on time\n", u(health.ticks), health.rate_hz,
              100 * health.on_time);
  const LateCounts& late = health.late;
  std::printf("%llu late: steal %llu, page fault %llu, pre-emption %llu, run queue %llu, unknown %llu\n",
              u(late.total()), u(late.steal), u(late.page_fault), u(late.preemption), u(late.run_queue),
              u(late.unknown));
  // the first entry is the thread that ran the ticks
  for (std::size_t n = 1; n < threads.size(); ++n)
    std::printf("%s: %llu updates, %llu late, %s\n", threads[n].device.c_str(), u(threads[n].updates),
                u(threads[n].late.total()), threads[n].scheduler.c_str());
  std::printf("%llu skipped, %llu dropped, %llu stalls\n", u(health.skipped), u(health.dropped),
              u(health.stalls));
}

// prints the number of ticks in which the force was changed or withheld, by reason; a pointer that is not
// pressed counts as at rest
void print_changed(const RecordingSummary& s, bool pointer) {
  const std::pair<const char*, std::uint64_t> counts[] = {{"clamped", s.clamped},
                                                          {"thermal", s.thermal},
                                                          {"slewed", s.slewed},
                                                          {"faded", s.ramped},
                                                          {"blended", s.blended},
                                                          {"paused", s.paused},
                                                          {"clutched", s.clutched},
                                                          {"outside", s.outside},
                                                          {pointer ? "at rest" : "stale", s.stale},
                                                          {"not finite", s.not_finite},
                                                          {"jumped", s.jumped},
                                                          {"device fault", s.device_faults},
                                                          {"halted", s.halted},
                                                          {"emergency stop", s.emergency_stopped},
                                                          {"method missing", s.method_missing},
                                                          {"inside", s.inside},
                                                          {"wedged", s.wedged},
                                                          {"ruptured", s.ruptured},
                                                          {"damped", s.passivated},
                                                          {"turn held", s.rotation_limited}};
  std::string text;
  for (const auto& [name, count] : counts)
    if (count > 0) text += (text.empty() ? "" : ", ") + std::string(name) + " " + std::to_string(count);
  std::printf("force changed in ticks: %s\n", text.empty() ? "none" : text.c_str());
}

}  // namespace

void print_explore_result(const ExploreResult& result, bool pointer) {
  print_touches(result.touches);
  print_holds(result.holds);
  print_loop(result.health, result.threads);
  print_changed(result.summary, pointer);
  std::printf("largest force %.3f N of %.3f N allowed\n", result.max_force_N, result.limit_N);
  std::printf("run hash %016llx\n", u(result.summary.run_hash));
}

void print_tip_error(const ViewedNavigation& navigation) {
  if (navigation.tip)
    std::printf("error of the tracked tip %.3f mm (TRE, root mean square), below %.3f in 95 of 100 cases%s\n",
                navigation.tip->rms_mm, navigation.tip->max_mm,
                navigation.tip->is_far ? "; far outside the registration points" : "");
  else
    std::printf("error of the tracked tip (TRE) unknown\n");
  std::printf("residual at the points %.3f mm (FRE)\n", navigation.fre_mm);
}

void print_runs(const std::vector<FinishedRun>& runs, const TrainingOptions& training) {
  for (const FinishedRun& finished : runs) {
    const auto offered = std::ranges::find(training.tasks, finished.run.task, &OfferedTask::name);
    PALPATE_CHECK(offered != training.tasks.end());
    std::printf("\n");
    print_score(offered->file, finished.run.score, "run " + std::to_string(finished.run.number));
    std::printf("  ticks %llu to %llu; %d of %d in a row\n", u(finished.run.ticks.first),
                u(finished.run.ticks.last), finished.history.in_a_row, offered->file.in_a_row);
  }
}

void warn_of_problems(std::vector<std::string> problems, const std::string& printed_warnings,
                      Console& console) {
  constexpr std::size_t kMaxWarnings = 10;
  std::erase_if(problems,
                [&](const std::string& one) { return printed_warnings.find(one) != std::string::npos; });
  for (std::size_t i = 0; i < std::min(kMaxWarnings, problems.size()); ++i) console.warn()(problems[i]);
  if (problems.size() > kMaxWarnings)
    console.warn()("and " + std::to_string(problems.size() - kMaxWarnings) + " more like these");
}

}  // namespace palpate::app
