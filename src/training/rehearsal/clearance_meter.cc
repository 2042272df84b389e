#include "rehearsal/clearance_meter.h"

#include <algorithm>
#include <limits>

namespace palpate {
namespace {

// tolerance of the clearance far from a structure, below which a possible new minimum is not evaluated
constexpr double kFarTolerance_mm = 0.05;

}  // namespace

ClearanceMeter::ClearanceMeter(const std::vector<StructureDistance>& distances,
                               const std::map<LabelId, double>& requested_mm, std::size_t intervals) {
  for (const StructureDistance& distance : distances) {
    Structure& structure = structures_.emplace_back();
    structure.distance = &distance;
    structure.approach.label = distance.label();
    structure.approach.over_time_mm.assign(intervals, std::numeric_limits<float>::quiet_NaN());
    if (const auto requested = requested_mm.find(distance.label()); requested != requested_mm.end())
      structure.approach.requested_mm = requested->second;
  }
}

void ClearanceMeter::observe(const MeterInput& now) {
  for (Structure& structure : structures_) observe(now, structure);
}

void ClearanceMeter::observe(const MeterInput& now, Structure& structure) {
  StructureClearance& approach = structure.approach;
  float& in_interval = approach.over_time_mm[now.interval];
  // Beyond the surface's own distance field the clearance changes by at most the displacement of the head. It
  // is not evaluated while it cannot be a new minimum and no required clearance is at stake.
  if (structure.known && !std::isnan(in_interval)) {
    const double lower_bound_mm = structure.gap_mm - now.head.moved_mm(structure.head);
    const double widest_mm = std::max(now.head.radius_mm, now.head.end_radius_mm);
    if (lower_bound_mm > structure.distance->near_mm() + widest_mm &&
        lower_bound_mm + kFarTolerance_mm >= static_cast<double>(in_interval) &&
        lower_bound_mm >= approach.requested_mm.value_or(0))
      return end_violation(structure);
  }
  const double gap = gap_mm(*structure.distance, now.head);
  structure.known = true;
  structure.head = now.head;
  structure.gap_mm = gap;
  in_interval = std::fmin(in_interval, static_cast<float>(gap));
  if (!(gap >= approach.nearest_mm)) {
    approach.nearest_mm = gap;
    approach.nearest = now.point;
  }
  follow_violation(now, gap, structure);
}

void ClearanceMeter::follow_violation(const MeterInput& now, double gap, Structure& structure) {
  StructureClearance& approach = structure.approach;
  if (!approach.requested_mm || gap >= *approach.requested_mm) return end_violation(structure);
  if (!structure.violation) {
    structure.violation =
        ClearanceViolation{approach.label, *approach.requested_mm, gap, now.point, now.point, 0, 0};
  } else {
    approach.below_s += now.dt_s;
  }
  ClearanceViolation& violation = *structure.violation;
  violation.last_tick = now.point.tick;
  violation.end_s = now.point.time_s;
  if (gap < violation.nearest_mm) {
    violation.nearest_mm = gap;
    violation.nearest = now.point;
  }
}

void ClearanceMeter::end_violation(Structure& structure) {
  if (!structure.violation) return;
  if (violations_.size() < kMaxViolations)
    violations_.push_back(*structure.violation);
  else
    ++omitted_violations_;
  structure.violation.reset();
}

void ClearanceMeter::finish(PlanComparison& to) {
  for (Structure& structure : structures_) {
    end_violation(structure);
    to.approaches.push_back(std::move(structure.approach));
  }
  std::ranges::stable_sort(violations_, {},
                           [](const ClearanceViolation& violation) { return violation.begin.tick; });
  to.violations = std::move(violations_);
  to.omitted_violations = omitted_violations_;
}

}  // namespace palpate
