#include "report/timed_ticks.h"

#include <cmath>

namespace palpate::report {

TickTimes::TickTimes(const RecordingHead& head)
    : clock_rises_(head.is_clock_monotonic),
      period_s_(std::isfinite(head.header.rate_hz) && head.header.rate_hz > 0 ? 1 / head.header.rate_hz
                                                                              : 1e-3) {}

}  // namespace palpate::report
