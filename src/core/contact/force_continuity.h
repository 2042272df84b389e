#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <span>

#include "palpate/contact/proxy.h"

/// Force continuity of the proxy. Slip is the part of a force change that is not caused by the tool's own
/// displacement; its rate is limited to ProxyOptions::max_slip_N_per_s (docs/decisions/0033). It has three
/// sources, each with its limit here: displacement of the proxy along or off a surface (DisplacementBall),
/// change of the spring's stretched fraction (limit_stretch_mm) and change of stiffness (limit_stiffness).
namespace palpate {

/// Motion of a layer's spring in one tick.
struct SpringMotion {
  Vector<Patient> last_spring_mm;  ///< Spring vector (tip to proxy) of the last tick
  double tool_mm = 0;  ///< Displacement of the tip in this tick plus the arc of the tool's rotation
  /// tool_mm plus the displacement accumulated while the proxy was catching up at zero force.
  double tool_since_force_mm = 0;
  /// Upper limit of the spring vector's change in this tick: tool_mm plus the permitted slip.
  double max_change_mm = std::numeric_limits<double>::infinity();
};

/// Displacement limit of a proxy in one tick: a ball around its position displaced by the tip's displacement,
/// where the spring vector would be unchanged. The radius, i.e. the tool's displacement plus the permitted
/// slip, therefore bounds the change of the spring vector.
struct DisplacementBall {
  Point<Patient> centre;  ///< Centre: proxy position after the tool's rotation, plus the tip's displacement
  double radius_mm = std::numeric_limits<double>::infinity();  ///< Radius

  bool is_outside(const Point<Patient>& at) const { return (at - centre).norm() > radius_mm; }
  /// Whether a position is on the boundary, within the displacement that counts as rest, or outside.
  bool is_at_limit(const Point<Patient>& at) const {
    return (at - centre).norm() > radius_mm - kProxySettings.at_rest_mm;
  }
  /// Maximum fraction, 0 ... 1, of a displacement whose end is within the ball.
  double fraction_within(const Point<Patient>& from, const Vector<Patient>& displacement_mm) const {
    if (!is_outside(from + displacement_mm)) return 1;
    const Vector<Patient> out = from - centre;
    const double along = out.dot(displacement_mm), square = displacement_mm.squared_norm();
    if (!(square > 0)) return 0;
    const double beyond = radius_mm * radius_mm - out.squared_norm();
    const double root = std::sqrt(std::max(0.0, along * along + square * beyond));
    return std::clamp((root - along) / square, 0.0, 1.0);
  }
};

/// Displacement limit of a layer's proxy. Infinite without contact and after a puncture, which releases the
/// proxy at once.
/// @param layer        proxy after the tool's rotation, which may have pushed it
/// @param tip_moved    displacement of the tip in this tick, mm
/// @param turned_mm    arc length of the rotation (arc_of_rotation_mm)
/// @param max_slip_mm  permitted slip
DisplacementBall limit_displacement(const ProxyLayer& layer, const Vector<Patient>& tip_moved,
                                    double turned_mm, double max_slip_mm);

/// Rate-limited length of the spring: the length nearest to `target_mm` for which the spring vector differs
/// from that of the last tick by at most max_change_mm. If the direction alone changes by more, the last
/// length projected onto the new direction.
/// @param away_mm         vector from the tip to the proxy, the direction of the spring; not 0
/// @param target_mm       length for the current contacts
/// @param last_spring_mm  spring vector of the last tick, tip to proxy
/// @param max_change_mm   radius of the displacement limit; finite
/// @return length in mm, at most that of away_mm; 0 or less: the spring is inactive
double limit_stretch_mm(const Vector<Patient>& away_mm, double target_mm,
                        const Vector<Patient>& last_spring_mm, double max_change_mm);

/// Rate-limited spring stiffness. The stiffness depends on position and contacts. Its change is limited so
/// that the force changes by at most the displacement limit times the last stiffness. A spring that was
/// inactive starts with a stiffness at which its length beyond motion.tool_since_force_mm causes at most
/// `slip_N`.
/// @param requested  stiffness of the current contacts, N/mm
/// @param before     stiffness of the last tick, N/mm; empty: unknown, no limit
/// @param spring_mm  current spring vector, tip to proxy
/// @param slip_N     permitted force change in this tick beyond that caused by the tool's displacement
double limit_stiffness(double requested, std::optional<double> before, const Vector<Patient>& spring_mm,
                       double slip_N, const SpringMotion& motion);

/// Slip budget of one tick, spent by the layers from outside to inside.
struct SlipBudget {
  double remaining_N = 0;  ///< Force change that slip may still cause in this tick
  /// Stiffness by which slip of the current layer's proxy changes the force: sum over this layer and those
  /// within, in the last tick.
  double stiffness_N_per_mm = 0;

  /// Maximum slip of the current layer's proxy; infinite if that stiffness is 0.
  double max_slip_mm() const {
    return stiffness_N_per_mm > 0 ? remaining_N / stiffness_N_per_mm
                                  : std::numeric_limits<double>::infinity();
  }
  /// Subtracts the slip contained in a layer's force change.
  /// @param before_N_per_mm  spring stiffness of the layer in the last tick; empty: unknown
  /// @param now              force of the layer in this tick
  void spend(std::optional<double> before_N_per_mm, const ProxyForce& now, const SpringMotion& motion);
};

/// Arc length of a rotation at the tool point farthest from the tip.
double arc_of_rotation_mm(std::span<const ToolPart> parts, const Eigen::Quaterniond& from,
                          const Eigen::Quaterniond& to);

}  // namespace palpate
