#include "servo/bare_loop.h"

#include <cmath>
#include <thread>

#include "base/clock.h"
#include "palpate/check.h"
#include "servo/pacer.h"

namespace palpate {

BareLoop run_bare_loop(double rate_hz, double seconds, double spin_s, const RealtimeRequest& request,
                       const std::atomic<bool>& stop, LatencyHistogram& lateness) {
  PALPATE_CHECK(std::isfinite(seconds) && seconds >= 0);
  const auto points = static_cast<std::uint64_t>(std::llround(seconds * rate_hz));
  BareLoop loop;
  std::thread thread([&] {
    loop.grant = make_this_thread_realtime(request);
    Pacer pacer(rate_hz, spin_s, stop);
    while (loop.ticks + pacer.skipped() < points && pacer.wait()) {
      lateness.add(monotonic_ns() - pacer.scheduled_ns());
      ++loop.ticks;
    }
    loop.skipped = pacer.skipped();
  });
  thread.join();
  return loop;
}

}  // namespace palpate
