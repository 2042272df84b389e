#include "contact/force_continuity.h"

#include "contact/puncture.h"

namespace palpate {
namespace {

// force change of a layer that is not slip: caused by the tool's displacement, or, where infinite, exempt
// from the limit (last force unknown, deformable contact that begins, puncture)
double non_slip_change_N(std::optional<double> before_N_per_mm, const ProxyForce& now,
                         const SpringMotion& motion) {
  constexpr double kUnlimited = std::numeric_limits<double>::infinity();
  if (!before_N_per_mm) return kUnlimited;
  if (*before_N_per_mm == 0)
    return now.deformable ? kUnlimited : now.tangent_N_per_mm * motion.tool_since_force_mm;
  if (!std::isfinite(motion.max_change_mm)) return kUnlimited;
  return std::max(*before_N_per_mm, now.tangent_N_per_mm) * motion.tool_mm;
}

}  // namespace

DisplacementBall limit_displacement(const ProxyLayer& layer, const Vector<Patient>& tip_moved,
                                    double turned_mm, double max_slip_mm) {
  if (layer.contact_count == 0 || is_contact_punctured(layer)) return {};
  return {layer.position + tip_moved, tip_moved.norm() + turned_mm + max_slip_mm};
}

double limit_stretch_mm(const Vector<Patient>& away_mm, double target_mm,
                        const Vector<Patient>& last_spring_mm, double max_change_mm) {
  const double length_mm = away_mm.norm();
  // Lengths along the new direction whose spring vector lies in a ball around the last one: the projection
  // of the last vector, plus or minus half of the chord that the direction cuts from the ball.
  const double before_mm = last_spring_mm.dot(away_mm) / length_mm;
  const double turned_squared = last_spring_mm.squared_norm() - before_mm * before_mm;
  const double change_mm = std::sqrt(std::max(0.0, max_change_mm * max_change_mm - turned_squared));
  return std::min(std::clamp(target_mm, before_mm - change_mm, before_mm + change_mm), length_mm);
}

double limit_stiffness(double requested, std::optional<double> before, const Vector<Patient>& spring_mm,
                       double slip_N, const SpringMotion& motion) {
  const double length_mm = spring_mm.norm();
  if (!before || !(length_mm > 0)) return requested;
  // a spring that was inactive may already be longer than the tool's displacement explains
  const double beyond_mm = length_mm - motion.tool_since_force_mm;
  if (*before == 0) return beyond_mm > 0 ? std::min(requested, slip_N / beyond_mm) : requested;
  if (!std::isfinite(motion.max_change_mm)) return requested;
  // Stiffnesses whose force lies in a ball around the last force; its radius is the last stiffness times
  // max_change_mm. Lengths are relative to the current spring.
  const double projection = motion.last_spring_mm.dot(spring_mm) / (length_mm * length_mm);
  const double transverse_squared =
      motion.last_spring_mm.squared_norm() / (length_mm * length_mm) - projection * projection;
  const double change = motion.max_change_mm / length_mm;
  const double discriminant = change * change - transverse_squared;
  if (!(discriminant > 0)) return *before;
  return std::clamp(requested, *before * (projection - std::sqrt(discriminant)),
                    *before * (projection + std::sqrt(discriminant)));
}

void SlipBudget::spend(std::optional<double> before_N_per_mm, const ProxyForce& now,
                       const SpringMotion& motion) {
  const double changed_N = (now.force_N - motion.last_spring_mm * before_N_per_mm.value_or(0)).norm();
  remaining_N -= std::clamp(changed_N - non_slip_change_N(before_N_per_mm, now, motion), 0.0, remaining_N);
}

double ResidualForce::fade(double max_N) {
  const double before_N = force_N.norm();
  limit(std::max(0.0, before_N - max_N));
  return std::min(before_N, max_N);
}

void ResidualForce::limit(double max_N) {
  const double before_N = force_N.norm();
  if (!(before_N > max_N)) return;
  // a zero limit clears the torque and the energy exactly
  if (!(max_N > 0)) {
    *this = {};
    return;
  }
  const double left = max_N / before_N;
  force_N = force_N * left;
  torque_Nmm = torque_Nmm * left;
  // quadratic in the force, as for a spring of constant stiffness
  stored_mJ *= left * left;
}

double arc_of_rotation_mm(std::span<const ToolPart> parts, const Eigen::Quaterniond& from,
                          const Eigen::Quaterniond& to) {
  if (from.coeffs() == to.coeffs()) return 0;
  double farthest_mm = 0;
  for (const ToolPart& part : parts)
    farthest_mm = std::max({farthest_mm, part.offset_mm.norm(), (part.offset_mm + part.axis_mm).norm()});
  return farthest_mm * from.angularDistance(to);
}

}  // namespace palpate
