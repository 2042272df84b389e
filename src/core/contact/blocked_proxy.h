#pragma once

#include <cstddef>
#include <optional>

#include "contact/near_surfaces.h"
#include "palpate/geometry/geometry.h"

/// Proxy that a surface blocks although no half-space explains it: where a gap closes, or thin tissue lies in
/// a gap, normals may point towards the tip through the surface.
namespace palpate {

/// Contact that explains why a proxy is blocked.
struct BlockingContact {
  std::size_t pair = 0;    ///< Pair whose surface blocks
  Vector<Patient> normal;  ///< Direction from the tip to the proxy
  double multiplier_mm = 0;
};
/// Contact with the surface nearest to a blocked proxy; without it there would be no force at any depth of
/// the tip. The multiplier is the depth of the tip, not its distance to the proxy, so that a tip that has
/// emerged elsewhere is not pulled back. Empty if no surface is in reach of the proxy or the tip is in none.
std::optional<BlockingContact> blocking_contact(PairSet& pairs, const Point<Patient>& proxy,
                                                const Point<Patient>& tip);

/// Directions in which a blocked proxy searches: straight to the tip, then on cones of increasing angle.
class SearchDirections {
 public:
  explicit SearchDirections(const Vector<Patient>& to_tip);
  /// @param cone  0 ... ProxySettings::search_cones - 1
  /// @param n     0 ... count(cone) - 1
  /// @return unit vector
  Eigen::Vector3d direction(int cone, int n) const;
  static int count(int cone) { return cone == 0 ? 1 : kProxySettings.search_directions; }

 private:
  Eigen::Vector3d ahead_, right_, up_;
};

}  // namespace palpate
