#include "contact/substep.h"

#include <algorithm>

namespace palpate {

LimitedStep limit_step(const ProxyLayer& layer, const Point<Patient>& goal, double max_mm, bool in_contact,
                       const DisplacementBall& limit) {
  const Vector<Patient> to_goal = goal - layer.position;
  double fraction = std::min(1.0, max_mm / to_goal.norm());
  if (in_contact && to_goal.dot(layer.last_displacement) < 0) fraction *= 0.5;
  const double fraction_within = limit.fraction_within(layer.position, to_goal);
  const bool at_limit = fraction_within < fraction;
  fraction = std::min(fraction, fraction_within);
  return {fraction < 1 ? layer.position + to_goal * fraction : goal, at_limit};
}

ValidatedStep validate_step(PairSet& pairs, const Point<Patient>& from, const Point<Patient>& end,
                            const StepConditions& conditions, const DisplacementBall& limit) {
  const double substep_mm = conditions.substep_mm;
  ValidatedStep step{false, false, end, end};
  if (!project_out(pairs, kProxySettings.max_corrections, substep_mm, step.position)) return step;
  // the projection may have moved the point beyond the displacement limit
  if (limit.is_outside(step.position)) {
    step.end = from + (end - from) * limit.fraction_within(from, step.position - from);
    step.position = step.end;
    if (!project_out(pairs, kProxySettings.max_corrections, substep_mm, step.position)) return step;
    step.at_limit = true;
  }
  // the ends of a longer projection do not bound the penetration between them
  if ((step.position - step.end).norm() > substep_mm) return step;
  const double away_mm = conditions.max_distance_increase * (step.position - from).norm();
  step.accepted = !((conditions.tip - step.position).norm() > (conditions.tip - from).norm() + away_mm);
  return step;
}

}  // namespace palpate
