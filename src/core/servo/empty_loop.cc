#include "palpate/servo/empty_loop.h"

#include <chrono>
#include <cmath>
#include <future>
#include <string>
#include <system_error>
#include <thread>

#include "palpate/base/check.h"
#include "palpate/base/clock.h"
#include "servo/pacer.h"

namespace palpate {
namespace {

constexpr auto kBareLoopPoll = std::chrono::milliseconds(5);

}  // namespace

Result<EmptyLoopResult> measure_empty_loop(double rate_hz, double seconds, double spin_s,
                                           const RealtimeRequest& request, LatencyHistogram& lateness,
                                           const Progress& progress) {
  PALPATE_CHECK(std::isfinite(seconds) && seconds >= 0);
  const auto points = static_cast<std::uint64_t>(std::llround(seconds * rate_hz));
  EmptyLoopResult loop;
  std::atomic<bool> stop{false};
  std::promise<void> done;
  const auto ended = done.get_future();
  std::thread thread;
  try {
    thread = std::thread([&] {
      loop.grant = make_this_thread_realtime(request);
      Pacer pacer(rate_hz, spin_s, stop);
      while (loop.ticks + pacer.skipped() < points && pacer.wait()) {
        lateness.add(monotonic_ns() - pacer.scheduled_ns());
        ++loop.ticks;
      }
      loop.skipped = pacer.skipped();
      done.set_value();
    });
  } catch (const std::system_error& error) {
    return Error{ErrorKind::kUnavailable,
                 std::string("cannot start a thread for the empty loop: ") + error.what(), "",
                 "close other programs, or raise the process limit (ulimit -u)"};
  }
  while (ended.wait_for(kBareLoopPoll) != std::future_status::ready)
    if (progress.stopped()) stop = true;
  thread.join();
  if (progress.stopped()) return Progress::interrupted();
  return loop;
}

}  // namespace palpate
