#include "session/session_statistics.h"

#include <algorithm>

#include "palpate/base/clock.h"
#include "palpate/palpation/plain_vectors.h"

namespace palpate {
namespace {

constexpr double kParts_per_s = 10;

}  // namespace

SessionStatistics::SessionStatistics(const Model& model, const std::vector<HoldRequest>& holds)
    : nearest_(model) {
  for (const HoldRequest& structure : holds) meters_.emplace_back(model, structure);
}

void SessionStatistics::observe(const TickRecord& record) {
  const std::lock_guard lock(mutex_);
  for (HoldMeter& meter : meters_) meter.observe(record);
  nearest_.observe(record);
  for (int d = 0; d < record.devices; ++d)
    max_force_N_ = std::max(max_force_N_, norm(record.device[d].force_N));

  tenth_ = static_cast<std::uint64_t>(std::max(0.0, record.time_s) * kParts_per_s);
  Part& part = parts_[tenth_ % kParts];
  if (part.tenth != tenth_) {
    part.tenth = tenth_;
    part.lateness.clear();
    part.compute.clear();
  }
  part.lateness.add(to_ns(record.lateness_s));
  part.compute.add(to_ns(record.compute_s));
}

SessionStatistics::LastSecond SessionStatistics::last_second() const {
  LatencyHistogram lateness, compute;
  {
    const std::lock_guard lock(mutex_);
    for (const Part& part : parts_) {
      if (part.tenth + kParts <= tenth_) continue;
      lateness.merge(part.lateness);
      compute.merge(part.compute);
    }
  }
  const auto late = lateness.summary();
  return {late.p50_us, late.p99_us, late.max_us, compute.quantile_us(0.5)};
}

std::vector<HoldFigure> SessionStatistics::holds() const {
  const std::lock_guard lock(mutex_);
  std::vector<HoldFigure> figures;
  for (const HoldMeter& meter : meters_) figures.push_back(meter.figure());
  return figures;
}

std::map<LabelId, double> SessionStatistics::nearest_mm() const {
  const std::lock_guard lock(mutex_);
  return nearest_.nearest_mm();
}

double SessionStatistics::max_force_N() const {
  const std::lock_guard lock(mutex_);
  return max_force_N_;
}

}  // namespace palpate
