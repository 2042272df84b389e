#include "palpate/contact/acting_force.h"

#include <algorithm>

namespace palpate {
namespace {

// duration for which a command sent `age_s` ago is between two ages
double overlap_s(const DelayLine::Sample& sample, double age_s, double from_s, double to_s) {
  return std::max(0.0, std::min(age_s, to_s) - std::max(age_s - sample.time_s, from_s));
}

}  // namespace

Vector<World> advance_delay_line(const Vector<World>& sent_N, double dt_s, double delay_s, DelayLine& line) {
  if (!(delay_s > 0) || !(dt_s > 0)) {
    line.count = 0;
    line.dropped_older = dt_s > 0;
    return sent_N;
  }
  // a full line drops its oldest command
  if (line.count == static_cast<int>(line.samples.size())) {
    std::move(line.samples.begin() + 1, line.samples.end(), line.samples.begin());
    --line.count;
    line.dropped_older = true;
  }
  line.samples[static_cast<std::size_t>(line.count++)] = {sent_N, dt_s};

  // from the newest to the oldest: sums the part that acted, counts the commands still needed
  Vector<World> acted_N_s;
  double age_s = 0;
  int needed = 0;
  for (int n = line.count - 1; n >= 0; --n) {
    const DelayLine::Sample& sample = line.samples[static_cast<std::size_t>(n)];
    if (age_s < delay_s) ++needed;
    age_s += sample.time_s;
    acted_N_s += sample.force_N * overlap_s(sample, age_s, delay_s, delay_s + dt_s);
  }
  if (line.dropped_older)
    acted_N_s += line.samples[0].force_N * std::clamp(delay_s + dt_s - age_s, 0.0, dt_s);
  const int forgotten = line.count - needed;
  line.dropped_older = line.dropped_older || forgotten > 0;
  std::move(line.samples.begin() + forgotten, line.samples.begin() + line.count, line.samples.begin());
  line.count = needed;
  return acted_N_s / dt_s;
}

double pending_impulse_N_s(const DelayLine& line, const Vector<World>& along, double delay_s) {
  double sum_N_s = 0, age_s = 0;
  for (int n = line.count - 1; n >= 0; --n) {
    const DelayLine::Sample& sample = line.samples[static_cast<std::size_t>(n)];
    age_s += sample.time_s;
    sum_N_s += sample.force_N.dot(along) * overlap_s(sample, age_s, 0, delay_s);
  }
  return sum_N_s;
}

}  // namespace palpate
