#pragma once

#include <span>

#include "contact/constraint_gathering.h"
#include "contact/constraint_solver.h"
#include "contact/force_continuity.h"
#include "contact/near_surfaces.h"
#include "palpate/contact/proxy.h"
#include "palpate/contact/proxy_path.h"

/// Update of one layer's proxy position in a tick: stages 2 to 5 of proxy.cc.
namespace palpate {

/// Inputs of the update of one layer's proxy position.
struct UpdateInputs {
  std::span<const ContactSurface> surfaces;
  std::span<const ToolPart> parts;  ///< Tool parts in the proxy's attitude
  int layer;
  Point<Patient> tip;
  double max_mm;                   ///< Maximum path length
  DisplacementBall limit;          ///< Displacement limit before a release of static friction extends it
                                   ///< (adopt_friction())
  Vector<Patient> last_spring_mm;  ///< Spring vector of the last tick, tip to proxy
  bool friction;                   ///< Whether friction is rendered
  bool has_capsules;
  /// Maximum fraction of a substep by which the distance to the tip may increase
  double max_distance_increase;
  ProxyPath* path;  ///< Receives every vertex of the path; may be null
};

/// Working memory shared by the position updates of a tick; constructing it takes longer than many updates.
struct UpdateWorkspace {
  PairSet pairs;
  ContactConstraints constraints;
  PairFriction friction;
  ContactOrigins origins;
};

/// Result of a position update.
struct PositionUpdate {
  bool wedged = false, lagging = false;  ///< As in ProxyResult
  bool inside = false;  ///< The proxy started inside surfaces and could not be pushed out of them
};

/// Moves one layer's proxy towards the tip along the surfaces, with its attitude fixed.
PositionUpdate update_position(const UpdateInputs& in, ProxyLayer& layer, ProxyLayerCache& cache,
                               UpdateWorkspace& work);

}  // namespace palpate
