#include "contact/tool_turn.h"

#include <algorithm>
#include <cmath>

#include "contact/capsule_row.h"
#include "contact/near_surfaces.h"

/// Swept rotation of the tool about its tip. In a rotation by an angle a about an axis through the tip, a
/// sphere at distance r from the axis moves along an arc a * r. The step angle is the largest that every
/// clearance allows, plus a small advance:
///
///     a = min (clearance + kArc_mm) / (L r)        over sphere-surface pairs; L: max_gradient()
///
/// so that a sphere in contact still advances; the step may end at a depth of kArc_mm. The tool is then
/// pushed out of all surfaces by one common translation p. In such a step (rotation and translation at once)
/// a sphere moves by at most a r + p, and both of its end positions are outside. In between, its depth below
/// the surface is at most
///
///     (L (a r + p) - clearance) / 2
///
/// A step is accepted if that is at most half of substep_mm(), which is less than
/// ProxySettings::max_penetration_mm; otherwise it is retried with half the angle.
namespace palpate {
namespace {

// arc length that a step advances beyond the clearance: the push of a perpendicularly hit surface is as long
constexpr double kArc_mm = kToolRotationSettings.arc_substeps * kProxySettings.substep_mm();

/// Rotation of the tool of one layer's proxy in a tick.
class AttitudeUpdate {
 public:
  AttitudeUpdate(std::span<const ContactSurface> surfaces, std::span<const ToolPart> parts, int layer,
                 const Eigen::Quaterniond& attitude, ProxyLayer& state, ProxyPath* path)
      : surfaces_(surfaces),
        parts_(parts),
        layer_(layer),
        attitude_(attitude),
        state_(state),
        path_(path),
        remaining_queries_(has_capsules(parts) ? kToolRotationSettings.max_queries_of_capsules
                                               : kToolRotationSettings.max_queries) {}

  /// Runs the rotation until the attitude is reached, blocked, or the work limit ends it.
  ToolTurn run() {
    record_pose();
    for (int leg = 0; leg < kToolRotationSettings.max_legs && remaining_steps_ > 0; ++leg)
      if (!run_leg()) return result_;
    result_.lagging = true;
    return result_;
  }

 private:
  // rotates by at most one leg, for which surfaces are gathered once; false if the rotation ends with it
  bool run_leg() {
    const Eigen::Quaterniond start_attitude = state_.attitude;
    const Eigen::AngleAxisd remaining(attitude_ * start_attitude.conjugate());
    const RotatedTool tool(parts_, attitude_, start_attitude);
    farthest_mm_ = 0;
    for (std::size_t k = 0; k < tool.parts().size(); ++k) {
      // the ends of a capsule's axis bound the arcs of all points between them
      const ToolPart& part = tool.parts()[k];
      radius_mm_[k] = std::max(remaining.axis().cross(part.offset_mm.eigen()).norm(),
                               remaining.axis().cross((part.offset_mm + part.axis_mm).eigen()).norm());
      farthest_mm_ = std::max(farthest_mm_, radius_mm_[k]);
    }
    const double remaining_arc_mm = remaining.angle() * farthest_mm_;
    if (remaining_arc_mm <= kProxySettings.outside_mm) return arrive();

    const double leg_rad = remaining_arc_mm > kToolRotationSettings.leg_mm
                               ? kToolRotationSettings.leg_mm / farthest_mm_
                               : remaining.angle();
    PairSet pairs(
        surfaces_, tool.parts(), layer_, state_.punctured, state_.position,
        kToolRotationSettings.gathering_legs * leg_rad * farthest_mm_ + kProxySettings.substep_mm());
    // the push of a step is at most substep_mm() and is added to the arc
    reach_mm_ = pairs.reach_mm() - kProxySettings.substep_mm();
    double done_rad = 0;
    // beyond the work limit, the next tick continues
    max_queries_ = pairs.queries() + remaining_queries_;
    while (remaining_steps_ > 0 && pairs.queries() < max_queries_ && done_rad < leg_rad &&
           reach_mm_ > kProxySettings.outside_mm) {
      --remaining_steps_;
      const double step_rad = step(pairs, remaining, start_attitude, done_rad, leg_rad - done_rad);
      if (!(step_rad > 0)) {
        (pairs.queries() < max_queries_ || !has_turned_ ? result_.blocked : result_.lagging) = true;
        return false;
      }
      done_rad += step_rad;
      has_turned_ = true;
    }
    remaining_queries_ = max_queries_ - pairs.queries();
    if (done_rad >= remaining.angle()) return arrive();
    result_.lagging = done_rad == 0 || remaining_queries_ <= 0;
    return !result_.lagging;
  }

  // takes over the target attitude bit-exactly
  bool arrive() {
    state_.attitude = attitude_;
    return false;
  }

  // one step of at most max_rad; returns the angle that was taken, 0 if none
  double step(PairSet& pairs, const Eigen::AngleAxisd& remaining, const Eigen::Quaterniond& start_attitude,
              double done_rad, double max_rad) {
    double angle_rad = std::min(max_rad, reach_mm_ / farthest_mm_);
    for (std::size_t n = 0; n < pairs.count(); ++n) {
      const double slope =
          pairs[n].surface->max_gradient() * radius_mm_[static_cast<std::size_t>(pairs[n].part)];
      clearance_mm_[n] = std::max(
          0.0, pairs.clearance(n, state_.position, std::max(kProxySettings.skin_mm, slope * angle_rad)));
      if (slope * angle_rad > clearance_mm_[n] + kArc_mm) angle_rad = (clearance_mm_[n] + kArc_mm) / slope;
    }
    const double substep_mm = kProxySettings.substep_mm() / pairs.max_gradient();
    for (int tries = 0; tries <= kToolRotationSettings.max_halvings; ++tries, angle_rad *= 0.5) {
      // the first step of a tick is always completed, so that the rotation progresses however many surfaces
      // are near
      if (tries > 0 && has_turned_ && pairs.queries() >= max_queries_) return 0;
      const Eigen::Quaterniond turned =
          (Eigen::AngleAxisd(done_rad + angle_rad, remaining.axis()) * start_attitude).normalized();
      pairs.turn(RotatedTool(parts_, attitude_, turned).parts());
      Point<Patient> position = state_.position;
      if (!project_out(pairs, kProxySettings.max_corrections, substep_mm, position)) continue;
      const double push_mm = (position - state_.position).norm();
      if (!is_safe(pairs, angle_rad, push_mm)) continue;
      reach_mm_ -= angle_rad * farthest_mm_ + push_mm;
      state_.position = position;
      state_.attitude = turned;
      record_pose();
      return angle_rad;
    }
    return 0;
  }

  // whether no sphere penetrates beyond the tolerance between the ends of a step
  bool is_safe(const PairSet& pairs, double angle_rad, double push_mm) const {
    for (std::size_t n = 0; n < pairs.count(); ++n) {
      const double length_mm = angle_rad * radius_mm_[static_cast<std::size_t>(pairs[n].part)] + push_mm;
      if (pairs[n].surface->max_gradient() * length_mm > clearance_mm_[n] + kProxySettings.substep_mm())
        return false;
    }
    return true;
  }

  void record_pose() {
    if (path_ != nullptr) path_->add(state_.position, state_.attitude);
  }

  std::span<const ContactSurface> surfaces_;
  std::span<const ToolPart> parts_;
  const int layer_;
  const Eigen::Quaterniond attitude_;
  ProxyLayer& state_;
  ProxyPath* path_;
  ToolTurn result_;
  std::array<double, kMaxToolParts> radius_mm_{};  // radii of the spheres' arcs
  double farthest_mm_ = 0;                         // maximum of radius_mm_
  double reach_mm_ = 0;  // displacement of any sphere for which the gathered surfaces are complete
  std::array<double, kMaxPairs> clearance_mm_{};
  int remaining_steps_ = kToolRotationSettings.max_steps;
  int remaining_queries_;  // queries left in this tick after the current leg
  int max_queries_ = 0;    // query count at which the current leg stops
  bool has_turned_ = false;
};

}  // namespace

ToolTurn turn_tool(std::span<const ContactSurface> surfaces, std::span<const ToolPart> parts, int layer,
                   const Eigen::Quaterniond& attitude, ProxyLayer& state, ProxyPath* path) {
  if (state.attitude.coeffs() == attitude.coeffs()) return {};
  return AttitudeUpdate(surfaces, parts, layer, attitude, state, path).run();
}

}  // namespace palpate
