#pragma once

#include <cstddef>
#include <limits>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/contact/distances.h"
#include "palpate/geometry/geometry.h"

/// No-go regions: forbidden-region virtual fixtures (Rosenberg 1993; Abbott, Marayong & Okamura 2007), based
/// on the distance to the region.
namespace palpate {

/// Region of one structure, touchable or not.
struct NoGoStructure {
  /// Label of the structure.
  LabelId label = 0;
  int tracked = -1;  ///< Index into DistanceTrees::structures(). -1: not prepared, no force
};
/// Half-space behind a plane.
struct NoGoPlane {
  Point<Patient> point;     ///< A point of the plane
  Vector<Patient> outward;  ///< Normal towards the allowed side; unit
};
/// Spherical region.
struct NoGoSphere {
  Point<Patient> centre;
  double radius_mm = 1;
};

/// Permitted ranges of the parameters.
inline constexpr double kMaxKeepAway_mm = 20;
inline constexpr struct { double min, max; } kNoGoStiffness_N_per_mm{0.01, 20}, kNoGoRadius_mm{0.1, 500};

/// Region that the tool is pushed out of by a one-sided spring.
struct NoGoRegion {
  std::string name;
  std::variant<NoGoStructure, NoGoPlane, NoGoSphere> shape;
  double keep_away_mm = 0;  ///< Distance before the region at which the force begins; 0 ... kMaxKeepAway_mm
  double stiffness_N_per_mm = 1;  ///< Spring stiffness; in kNoGoStiffness_N_per_mm
};
inline constexpr std::size_t kMaxNoGo = 64;  ///< Maximum number of regions of a model

/// Checks the regions of a model. Errors: kBadInput for more than kMaxNoGo regions, a parameter out of
/// range, or a plane whose `outward` is not a unit vector.
Result<void> check_no_go(std::span<const NoGoRegion> regions);

/// Total force of all regions on a tool.
struct NoGoForce {
  Vector<Patient> force_N;        ///< Force on the tip
  Vector<Patient> torque_Nmm;     ///< Torque about the tip
  double stored_mJ = 0;           ///< Elastic energy of the springs
  double stiffness_N_per_mm = 0;  ///< Stiffness of the stiffest active region. 0: none is active
  int region = -1;                ///< Region with the largest depth. -1: no region is active
  double depth_mm = 0;            ///< Its depth: keep_away_mm minus the distance of the tool's outline
};

/// Force of all no-go regions: one-sided springs. A tool nearer to a region than keep_away_mm is pushed along
/// the gradient of the distance, with stiffness times depth, acting at the tool's nearest point.
///
/// If several regions are active, a virtual proxy connects the tip to their springs: the force is that of a
/// spring of `max_stiffness_N_per_mm` from the tip to the position u that minimises the total energy of this
/// spring and the regions' springs (Moreau envelope of the regions' energy). The stiffness in any direction
/// is then at most that limit, however many regions overlap. A region active alone keeps its own stiffness K:
/// its spring has the stiffness K L / (L - K), L being the limit, which in series with the spring to the tip
/// gives K. Each region is linearised at the tool; for planes the force has a potential, for curved regions
/// approximately.
///
/// At most kMaxActiveNoGo regions act at a time, the deepest. Stateless; bounded work; does not allocate,
/// lock or throw.
/// @param parts                   tool parts in the operator's pose
/// @param tip                     position of the tip
/// @param max_stiffness_N_per_mm  limit in the patient; no region is stiffer than nine tenths of it. 0: no
///                                force
NoGoForce no_go_force(std::span<const NoGoRegion> regions, const DistanceTrees& trees,
                      std::span<const ToolPart> parts, const Point<Patient>& tip,
                      double max_stiffness_N_per_mm = std::numeric_limits<double>::infinity());
inline constexpr std::size_t kMaxActiveNoGo = 8;  ///< Maximum number of regions that act at a time

}  // namespace palpate
