#include "palpate/palpation/hold_meter.h"

#include <algorithm>
#include <cmath>

#include "palpate/palpation/plain_vectors.h"

namespace palpate {

HoldMeter::HoldMeter(const Model& model, const HoldRequest& hold)
    : forces_N_(hold.forces_N), unbroken_s_(std::max<std::size_t>(1, hold.forces_N.size()), 0.0) {
  figure_.label = hold.structure;
  figure_.structure = model.name_of(hold.structure);
}

void HoldMeter::observe(const TickRecord& record) {
  const DeviceTick& device = record.device[0];
  const double force_N = norm(device.force_N);
  const bool own = device.label == figure_.label;
  if (own) {
    sum_N_ += force_N;
    ++ticks_;
    figure_.peak_force_N = std::max(figure_.peak_force_N, force_N);
  }
  for (std::size_t f = 0; f < unbroken_s_.size(); ++f) {
    const bool held =
        own && (forces_N_.empty() || std::abs(force_N - forces_N_[f]) <= kHoldTolerance * forces_N_[f]);
    unbroken_s_[f] = held ? unbroken_s_[f] + record.dt_s : 0;
    figure_.held_s = std::max(figure_.held_s, unbroken_s_[f]);
  }
}

HoldFigure HoldMeter::figure() const {
  HoldFigure figure = figure_;
  figure.mean_force_N = ticks_ ? sum_N_ / static_cast<double>(ticks_) : 0;
  return figure;
}

}  // namespace palpate
