#include "palpate/contact/proxy.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <span>

#include "contact/blocked_proxy.h"
#include "contact/capsule_row.h"
#include "contact/constraint_gathering.h"
#include "contact/constraint_solver.h"
#include "contact/contact_springs.h"
#include "contact/force_continuity.h"
#include "contact/near_surfaces.h"
#include "contact/proxy_spheres.h"
#include "contact/puncture.h"
#include "contact/substep.h"
#include "contact/tool_turn.h"
#include "contact/withdrawal.h"
#include "palpate/contact/proxy_path.h"

/// One tick advances the proxy of every layer, from outside to inside. The method is the god-object of Zilles
/// & Salisbury (1995), for a tool of finite size as in Ruspini, Kolarov & Khatib (1997):
///
/// 1. Turn: the proxy's tool is rotated about its tip to the operator's attitude, in collision-checked steps
///    (tool_turn.h).
/// 2. Gather: the tangent plane of each surface in contact becomes a half-space constraint of the proxy's
///    position (constraint_gathering.h).
/// 3. Solve: the goal is the point nearest to the tip in the intersection of all half-spaces, shifted by
///    friction towards the position at which the proxy sticks (constraint_solver.h).
/// 4. Limit: a substep moves the proxy towards the goal. In free space its length is bounded by the
///    clearance, in contact by the penetration permitted between its ends, and always by the slip that force
///    continuity permits (substep.h, force_continuity.h). A surface that it would penetrate is added to the
///    constraints, and the goal is solved again.
/// 5. Validate: the end of the substep is projected out of all surfaces; a substep that increases the
///    distance to the tip by more than a tolerance is rejected (substep.h). Steps 2 to 5 repeat until the
///    proxy is at rest or a work limit of the tick is reached.
/// 6. Force: a spring from the tip to the proxy, whose stretch and stiffness are rate-limited
///    (contact_springs.h), and puncture of each structure whose share of the spring force exceeds its
///    puncture force (puncture.h).
namespace palpate {
namespace {

// Reach of push_out(): number of projection steps times their maximum length. It is used when a proxy starts
// inside a surface, e.g. after a change to a larger tool.
constexpr double kMaxPushOut_mm = kProxySettings.max_corrections * kProxySettings.substep_mm();

/// Inputs of a tick that all layers share.
struct TickInputs {
  std::span<const ContactSurface> surfaces;
  std::span<const ToolSphere> spheres;  ///< Tool parts in the operator's attitude
  const ToolPose& tool_pose;
  Point<Patient> tip_before;  ///< Tip position of the last tick
  const ProxyOptions& options;

  Vector<Patient> tip_moved() const { return tool_pose.tip - tip_before; }
};

/// Inputs of the update of one layer's proxy position.
struct UpdateInputs {
  std::span<const ContactSurface> surfaces;
  std::span<const ToolSphere> spheres;  ///< Tool parts in the proxy's attitude
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

/// Progress of a position update.
struct UpdateProgress {
  FrictionState friction;
  DisplacementBall limit;
  bool at_limit = false;          ///< The last substep was shortened by the displacement limit
  bool wedged = false;            ///< Whether the half-spaces have no common point
  bool contacts_updated = false;  ///< The layer's contacts are from this update; false: from the last tick
  double remaining_beyond_segment_mm;  ///< Path length left after the current segment, i.e. the one whose
                                       ///< surfaces have been gathered
  double remaining_in_segment_mm = 0;  ///< Path length left in the current segment
  double max_gradient = 1;             ///< Maximum slope of the gathered distance fields, mm/mm; at least 1
  int max_queries = 0;                 ///< Surface queries after which no substep starts

  /// Maximum length of a substep in contact.
  double substep_mm() const { return kProxySettings.substep_mm() / max_gradient; }
};

/// Result of a position update.
struct PositionUpdate {
  bool wedged = false, lagging = false;  ///< As in ProxyResult
  bool inside = false;  ///< The proxy started inside surfaces and could not be pushed out of them
};

// appends a vertex to the path, if one is recorded
void record_vertex(const UpdateInputs& in, const ProxyLayer& layer, const Point<Patient>& vertex) {
  if (in.path != nullptr) in.path->add(vertex, layer.attitude);
}

// whether the proxy stopped at the displacement limit before it reached its goal
bool is_slipping(const ProxyLayer& layer, const UpdateProgress& progress) {
  return progress.at_limit && progress.limit.is_at_limit(layer.position);
}

// whether the proxy has not reached the tip although it has no contact (blocked_proxy.h)
bool is_blocked_without_contact(const UpdateInputs& in, const ProxyLayer& layer) {
  return layer.contact_count == 0 && (in.tip - layer.position).norm() > kProxySettings.arrived_mm;
}

// Gathers the surfaces within reach of the next path segment. In free space the segment is the whole path. In
// contact it is at most ProxySettings::gathering_mm, because the proxy usually moves only a small fraction of
// the distance to the tip and a shorter reach yields fewer pairs.
void gather_pairs(const UpdateInputs& in, const ProxyLayer& layer, UpdateProgress& progress,
                  UpdateWorkspace& work) {
  const double part_mm = layer.contact_count == 0
                             ? progress.remaining_beyond_segment_mm
                             : std::min(progress.remaining_beyond_segment_mm, kProxySettings.gathering_mm);
  work.pairs.gather(in.surfaces, in.spheres, in.layer, layer.punctured, layer.position,
                    part_mm + kProxySettings.substep_mm());
  work.friction.clear();
  progress.max_gradient = work.pairs.max_gradient();
  // the segment is shortened to the reach of the set of pairs, which is less than part_mm where the set is
  // full
  progress.remaining_in_segment_mm = std::min(part_mm, work.pairs.reach_mm());
  progress.remaining_beyond_segment_mm -= progress.remaining_in_segment_mm;
}

// Pushes a proxy that starts inside surfaces out of them, at most by kMaxPushOut_mm, and gathers again at the
// new position. Returns false if there is no position outside within that distance.
bool push_out(const UpdateInputs& in, ProxyLayer& layer, UpdateProgress& progress, UpdateWorkspace& work) {
  work.pairs.gather(in.surfaces, in.spheres, in.layer, layer.punctured, layer.position, kMaxPushOut_mm);
  progress.max_gradient = work.pairs.max_gradient();
  if (!project_out(work.pairs, kProxySettings.max_corrections, progress.substep_mm(), layer.position))
    return false;
  progress.remaining_beyond_segment_mm += progress.remaining_in_segment_mm;
  gather_pairs(in, layer, progress, work);
  return true;
}

// goal under the current constraints; empty if they have no common point
std::optional<Solution> solve(const UpdateInputs& in, const ProxyLayer& layer, const FrictionState& friction,
                              UpdateWorkspace& work, OwnerCache& owners) {
  return solve_constraints({in.surfaces, work.pairs, work.constraints, in.tip, layer.position, in.friction},
                           friction, work.friction, owners);
}

// Adopts the friction state of a solution. Where static friction has released the proxy, the displacement
// limit grows by the released distance, which is exempt from the slip limit.
void adopt_friction(const UpdateInputs& in, const Solution& solution, UpdateProgress& progress) {
  progress.friction = solution.friction;
  if (solution.released_mm) progress.limit.radius_mm = in.limit.radius_mm + *solution.released_mm;
}

// Whether the proxy remains at rest under its cached contacts, the common case, which needs no surface query.
// If not, layer and progress are unchanged and the constraints are empty.
bool try_stay_at_rest(const UpdateInputs& in, ProxyLayer& layer, ProxyLayerCache& cache,
                      UpdateProgress& progress, UpdateWorkspace& work) {
  const auto cached = cache.at_rest.find(layer.position, layer.punctured, in.spheres);
  if (cached.empty()) return false;
  work.pairs.clear();
  work.friction.clear();
  for (const RestingContacts::Constraint& one : cached) {
    const ContactSurface& surface = in.surfaces[static_cast<std::size_t>(one.surface)];
    const ToolSphere& sphere = in.spheres[static_cast<std::size_t>(one.sphere)];
    const std::size_t index = work.pairs.count();
    const ContactPair& pair =
        work.pairs.add_cached({surface.surface.get(), one.surface, one.sphere, sphere, 0});
    work.constraints.add_cached(pair, {one.normal, one.offset_mm});
    if (one.friction) work.friction.store(index, *one.friction);
  }
  FrictionState friction = progress.friction;
  friction.begin_contact(layer.position);
  const auto solution = solve(in, layer, friction, work, cache.owners);
  if (solution && solution->nearest.count > 0 &&
      (solution->goal - layer.position).norm() <= kProxySettings.at_rest_mm) {
    adopt_friction(in, *solution, progress);
    store_contacts(solution->nearest, work.pairs, work.constraints, layer, work.origins);
    progress.contacts_updated = true;
    layer.stretch_fraction = 1;
    return true;
  }
  work.constraints.clear();
  return false;
}

// Caches the constraints of a proxy at rest for the next tick. Precondition: the constraints are complete,
// i.e. gathered at the current position from all surfaces in reach.
void cache_contacts_at_rest(const UpdateInputs& in, const ProxyLayer& layer, const UpdateWorkspace& work,
                            ProxyLayerCache& cache) {
  const ContactConstraints& constraints = work.constraints;
  if (constraints.count() == 0 || constraints.count() > RestingContacts::kMaxConstraints) return;
  std::array<RestingContacts::Constraint, RestingContacts::kMaxConstraints> cached;
  for (std::size_t n = 0; n < constraints.count(); ++n) {
    const ContactPair& pair = constraints.pair(n);
    const HalfSpace& half_space = constraints.half_space(n);
    cached[n] = {half_space.normal, half_space.offset, pair.index, pair.sphere, std::nullopt};
    if (const Friction* friction = work.friction.find(work.pairs.index_of(pair)))
      cached[n].friction = *friction;
  }
  cache.at_rest.store(layer.position, layer.punctured, in.spheres,
                      std::span(cached).first(constraints.count()));
}

// Moves the proxy straight to the tip if no surface is in reach, the common case for most layers. Returns
// false, without a change, if a surface is in reach or the proxy was in contact.
bool try_move_freely(const UpdateInputs& in, ProxyLayer& layer, UpdateProgress& progress,
                     const UpdateWorkspace& work) {
  const Vector<Patient> to_tip = in.tip - layer.position;
  const double length_mm = to_tip.norm();
  if (work.pairs.count() > 0 || layer.contact_count > 0 ||
      length_mm + kProxySettings.at_rest_mm >= progress.remaining_in_segment_mm)
    return false;
  progress.friction.anchored = progress.friction.sticking = false;
  layer.stretch_fraction = 1;
  if (length_mm <= kProxySettings.at_rest_mm) return true;
  layer.position = in.tip;
  layer.last_displacement = to_tip;
  record_vertex(in, layer, layer.position);
  return true;
}

// Validate stage: moves the proxy to the projected end of a substep. Returns false if the substep is rejected
// or too short to count as motion.
bool try_step(const UpdateInputs& in, const Point<Patient>& end, ProxyLayer& layer, UpdateProgress& progress,
              UpdateWorkspace& work) {
  const ValidatedStep step =
      validate_step(work.pairs, layer.position, end,
                    {in.tip, progress.substep_mm(), in.max_distance_increase}, progress.limit);
  progress.at_limit = progress.at_limit || step.at_limit;
  if (!step.accepted) return false;
  const Vector<Patient> displacement = step.position - layer.position;
  progress.remaining_in_segment_mm -= std::max((step.end - layer.position).norm(), displacement.norm());
  layer.position = step.position;
  layer.last_displacement = displacement;
  record_vertex(in, layer, step.end);
  record_vertex(in, layer, step.position);
  return displacement.norm() > kProxySettings.at_rest_mm;
}

// limit stage: end of a substep towards a goal
Point<Patient> limited_end(const Point<Patient>& goal, double max_mm, const ProxyLayer& layer,
                           UpdateProgress& progress, const UpdateWorkspace& work) {
  const LimitedStep step = limit_step(layer, goal, std::min(max_mm, progress.remaining_in_segment_mm),
                                      work.constraints.count() > 0, progress.limit);
  progress.at_limit = step.at_limit;
  return step.end;
}

// Fallback where each attempt hits a further surface, because the normals change within one substep: halves
// the substep until its end penetrates no surface. Returns false if there is no such substep.
bool retry_shorter(const UpdateInputs& in, ProxyLayer& layer, OwnerCache& owners, UpdateProgress& progress,
                   UpdateWorkspace& work) {
  const auto solution = solve(in, layer, progress.friction, work, owners);
  if (!solution) return false;
  adopt_friction(in, *solution, progress);
  Vector<Patient> displacement =
      limited_end(solution->goal, progress.substep_mm(), layer, progress, work) - layer.position;
  for (int halving = 0; halving < kProxySettings.max_halvings; ++halving) {
    displacement = displacement * 0.5;
    const Point<Patient> end = layer.position + displacement;
    if (!penetrates_any(work.pairs, end)) return try_step(in, end, layer, progress, work);
  }
  return false;
}

// One substep: gather, solve, limit, validate. Returns false when the proxy has come to rest, the substep was
// rejected or the constraints have no common point.
bool advance_substep(const UpdateInputs& in, const Point<Patient>& start, ProxyLayer& layer,
                     ProxyLayerCache& cache, UpdateProgress& progress, UpdateWorkspace& work) {
  const double free_mm = gather_constraints(work.pairs, layer.position, work.constraints);
  if (work.constraints.count() > 0) progress.friction.begin_contact(layer.position);
  progress.at_limit = false;
  // a discarded attempt must neither release static friction nor extend the displacement limit: every attempt
  // starts from this state
  const FrictionState friction = progress.friction;
  const DisplacementBall limit = progress.limit;
  for (int attempt = 0; attempt < kProxySettings.max_attempts; ++attempt) {
    progress.friction = friction;
    progress.limit = limit;
    const auto solution = solve(in, layer, friction, work, cache.owners);
    if (!solution) {
      progress.wedged = true;
      return false;
    }
    adopt_friction(in, *solution, progress);
    store_contacts(solution->nearest, work.pairs, work.constraints, layer, work.origins);
    progress.contacts_updated = true;
    if ((solution->goal - layer.position).norm() <= kProxySettings.at_rest_mm) {
      const bool is_complete =
          attempt == 0 && layer.position == start && work.pairs.count() < kMaxPairs && !in.has_capsules;
      if (is_complete) cache_contacts_at_rest(in, layer, work, cache);
      return false;
    }
    const double max_mm = work.constraints.count() == 0 ? free_mm : progress.substep_mm();
    const Point<Patient> end = limited_end(solution->goal, max_mm, layer, progress, work);
    // a surface that this substep would penetrate is added to the constraints, and the goal is solved again
    if (add_penetrated(work.pairs, end, work.constraints)) continue;
    return try_step(in, end, layer, progress, work);
  }
  progress.friction = friction;
  progress.limit = limit;
  return retry_shorter(in, layer, cache.owners, progress, work);
}

// Searches the directions of blocked_proxy.h, longest substeps first, for a substep that decreases the
// distance to the tip, penetrates no surface and stays within the displacement limit. Takes the first one;
// returns false if there is none or the work limit is reached.
bool search_substep(const UpdateInputs& in, ProxyLayer& layer, UpdateProgress& progress,
                    UpdateWorkspace& work) {
  const SearchDirections search(in.tip - layer.position);
  const double shortest_mm = kProxySettings.substep_mm() / kProxySettings.search_shortest_divisor;
  for (double length_mm = std::min(progress.substep_mm(), progress.remaining_in_segment_mm);
       length_mm > shortest_mm; length_mm *= 0.5)
    for (int cone = 0; cone < kProxySettings.search_cones; ++cone)
      for (int n = 0; n < SearchDirections::count(cone); ++n) {
        const Vector<Patient> displacement(length_mm * search.direction(cone, n));
        const Point<Patient> end = layer.position + displacement;
        if (work.pairs.queries() >= progress.max_queries) return false;
        if (progress.limit.is_outside(end) || penetrates_any(work.pairs, end) ||
            (in.tip - end).norm() >= (in.tip - layer.position).norm())
          continue;
        if (try_step(in, end, layer, progress, work)) return true;
      }
  return false;
}

// Moves in substeps until the proxy is at rest, or until the limit of substeps, queries or path length is
// reached. A proxy that stops without contact before the tip continues with a direction search. Returns
// whether a limit stopped a proxy that was still moving.
bool advance_substeps(const UpdateInputs& in, const Point<Patient>& start, ProxyLayer& layer,
                      ProxyLayerCache& cache, UpdateProgress& progress, UpdateWorkspace& work) {
  progress.max_queries = work.pairs.queries() + (in.has_capsules ? kProxySettings.max_queries_of_capsules
                                                                 : kProxySettings.max_queries);
  int substeps = 0;
  bool is_moving = true;
  layer.stretch_fraction = 1;
  for (int search = 0;; ++search) {
    while (is_moving && substeps < kProxySettings.max_substeps &&
           work.pairs.queries() < progress.max_queries &&
           progress.remaining_in_segment_mm > kProxySettings.at_rest_mm) {
      is_moving = advance_substep(in, start, layer, cache, progress, work);
      substeps += is_moving;
      if (is_moving && progress.remaining_in_segment_mm <= kProxySettings.at_rest_mm)
        gather_pairs(in, layer, progress, work);
    }
    if (is_moving || progress.wedged || is_slipping(layer, progress) ||
        !is_blocked_without_contact(in, layer))
      break;
    is_moving = search < kProxySettings.max_direction_searches && search_substep(in, layer, progress, work);
    if (!is_moving) break;
    if (progress.remaining_in_segment_mm <= kProxySettings.at_rest_mm)
      gather_pairs(in, layer, progress, work);
  }
  return is_moving;
}

// Replaces the contacts of a blocked proxy by the one with the surface that blocks it, and stretches the
// spring by the depth of the tip only.
void add_blocking_contact(const UpdateInputs& in, ProxyLayer& layer, UpdateProgress& progress,
                          UpdateWorkspace& work) {
  const auto blocking = blocking_contact(work.pairs, layer.position, in.tip);
  if (!blocking) return;
  layer.contact_count = 0;
  add_contact(work.pairs, {blocking->pair, work.pairs.step(blocking->pair)}, blocking->normal,
              blocking->multiplier_mm, layer, work.origins);
  progress.contacts_updated = true;
  layer.stretch_fraction = blocking->multiplier_mm / (layer.position - in.tip).norm();
}

// Places the contact of a capsule that lies along a surface at the middle of the touching interval. The
// nearest point would jump along the axis from voxel to voxel.
void centre_capsule_contacts(ProxyLayer& layer, UpdateWorkspace& work) {
  for (int n = 0; n < layer.contact_count; ++n) {
    const ContactOrigin& origin = work.origins[static_cast<std::size_t>(n)];
    layer.contacts[static_cast<std::size_t>(n)].axis_fraction =
        work.pairs.middle_of_touching(origin.pair, layer.position, origin.step);
  }
}

// Rate-limits the stretch of the spring. The target is stretch_fraction times the distance to the proxy while
// there is a contact or the proxy slips through free space, otherwise zero. If contact has ended but the rate
// limit keeps the spring stretched, the first contact of the last tick is kept, with its normal along the
// spring, because stiffness and structure are those of a contact.
// @param through_free_space   the proxy is at the displacement limit without a contact
// @param first_contact_before  first contact of the last tick
void limit_stretch(const UpdateInputs& in, const UpdateProgress& progress, bool through_free_space,
                   const ProxyContact& first_contact_before, ProxyLayer& layer) {
  const Vector<Patient> away = layer.position - in.tip;
  const double away_mm = away.norm();
  if (!std::isfinite(progress.limit.radius_mm) || away_mm <= kProxySettings.arrived_mm) return;
  const double target_mm =
      through_free_space || layer.contact_count > 0 ? layer.stretch_fraction * away_mm : 0;
  const double now_mm = limit_stretch_mm(away, target_mm, in.last_spring_mm, progress.limit.radius_mm);
  if (now_mm <= 0) {
    layer.contact_count = 0;
    return;
  }
  layer.stretch_fraction = now_mm / away_mm;
  for (int n = 0; n < layer.contact_count; ++n)
    layer.contacts[static_cast<std::size_t>(n)].multiplier_mm *= now_mm / target_mm;
  if (layer.contact_count > 0) return;
  layer.contact_count = 1;
  layer.contacts[0] = first_contact_before;
  layer.contacts[0].normal = away.normalized();
  layer.contacts[0].multiplier_mm = now_mm;
}

// moves one layer's proxy towards the tip along the surfaces, with its attitude fixed
PositionUpdate update_position(const UpdateInputs& in, ProxyLayer& layer, ProxyLayerCache& cache,
                               UpdateWorkspace& work) {
  const Point<Patient> start = layer.position;
  const ProxyContact first_contact_before = layer.contacts[0];
  UpdateProgress progress;
  progress.friction = {layer.contact_count > 0, layer.sticking, layer.position};
  progress.limit = in.limit;
  progress.remaining_beyond_segment_mm = in.max_mm;
  work.constraints.clear();
  bool is_moving = false, through_free_space = false;
  if (try_stay_at_rest(in, layer, cache, progress, work)) {
    record_vertex(in, layer, layer.position);
  } else {
    gather_pairs(in, layer, progress, work);
    if (work.pairs.penetrates() && !push_out(in, layer, progress, work)) {
      layer.contact_count = 0;
      return {.wedged = true, .inside = true};
    }
    record_vertex(in, layer, layer.position);
    is_moving = !try_move_freely(in, layer, progress, work) &&
                advance_substeps(in, start, layer, cache, progress, work);
    // A blocking contact is added even if the proxy has not finished moving: one tick at zero force would be
    // perceptible.
    const bool is_blocked = is_blocked_without_contact(in, layer);
    through_free_space = is_slipping(layer, progress) && is_blocked;
    if (!progress.wedged && !through_free_space && is_blocked)
      add_blocking_contact(in, layer, progress, work);
  }
  layer.sticking = progress.friction.sticking;
  // contacts kept from the last tick are already centred
  if (progress.contacts_updated) centre_capsule_contacts(layer, work);
  limit_stretch(in, progress, through_free_space, first_contact_before, layer);
  return {progress.wedged, is_moving || is_slipping(layer, progress), false};
}

/// Result of advancing one layer's proxy by one tick.
struct ProxyAdvance {
  bool wedged = false, lagging = false;  ///< As in ProxyResult
  SpringMotion spring;
};

// rotates and moves one layer's proxy
ProxyAdvance advance_layer(const TickInputs& tick, int n, double max_slip_mm, ProxyLayer& layer,
                           ProxyLayerCache& cache, ProxyPath* path, UpdateWorkspace& work) {
  const std::span<const ContactSurface> surfaces = tick.surfaces;
  const std::span<const ToolSphere> spheres = tick.spheres;
  const Point<Patient>& tip = tick.tool_pose.tip;
  ProxyAdvance result;
  if (!layer.coupled) {
    if (!is_free(surfaces, spheres, n, {}, {}, tip)) return result;
    layer = {};
    cache.at_rest.invalidate();
    layer.coupled = true;
    layer.position = tip;
    layer.attitude = tick.tool_pose.attitude;
  }
  layer.punctured = still_open(surfaces, spheres, tick.tool_pose, layer);

  // rotation
  const Eigen::Quaterniond attitude_before = layer.attitude;
  const Vector<Patient> tip_moved = tick.tip_moved();
  result.spring.last_spring_mm = (layer.position - (tip - tip_moved)) * layer.stretch_fraction;
  const ToolTurn turn = turn_tool(surfaces, spheres, n, tick.tool_pose.attitude, layer, path);
  const ProxySpheres proxy_spheres(spheres, tick.tool_pose.attitude, layer.attitude);
  const double turned_mm = arc_of_rotation_mm(spheres, attitude_before, layer.attitude);

  // Position. Without contact the path may be as long as the distance to the tip; in contact its length per
  // tick is limited.
  const double to_tip_mm = (tip - layer.position).norm() + kProxySettings.slack_mm;
  const double max_mm =
      layer.contact_count == 0 ? to_tip_mm : std::min(to_tip_mm, kProxySettings.max_path_mm);
  const DisplacementBall limit = limit_displacement(layer, tip_moved, turned_mm, max_slip_mm);
  result.spring.tool_mm = tip_moved.norm() + turned_mm;
  result.spring.tool_since_force_mm = layer.catch_up_mm + result.spring.tool_mm;
  result.spring.max_change_mm = limit.radius_mm;
  const bool capsules = has_capsules(spheres);
  const double max_distance_increase = capsules ? std::min(tick.options.max_distance_increase,
                                                           kProxySettings.max_distance_increase_of_capsules)
                                                : tick.options.max_distance_increase;
  const PositionUpdate update =
      update_position({surfaces, proxy_spheres.spheres(), n, tip, max_mm, limit, result.spring.last_spring_mm,
                       tick.options.friction, capsules, max_distance_increase, path},
                      layer, cache, work);

  // A proxy is reset to a tip in free space at once if it is inside surfaces, and after lost_s if it has
  // stopped far from the tip without a contact.
  const bool is_far =
      !update.lagging && !turn.lagging && (tip - layer.position).norm() > kProxySettings.lost_mm;
  const bool is_stranded = layer.contact_count == 0 && (update.inside || is_far) &&
                           is_free(surfaces, spheres, n, layer.punctured, {}, tip);
  layer.stranded_s = is_stranded ? layer.stranded_s + tick.options.dt_s : 0;
  if (is_stranded && (update.inside || layer.stranded_s > kProxySettings.lost_s)) {
    layer.position = tip;
    layer.attitude = tick.tool_pose.attitude;
  }
  result.lagging = update.lagging || turn.lagging;
  result.wedged = update.wedged || turn.blocked;
  return result;
}

// Resets a layer whose covering layer no longer constrains the tool: the proxy takes the operator's pose
// without collision checks. Its last spring force becomes a residual force, with the stretch reduced by the
// tip's displacement in this tick: there is no residual force if the tip moved at least as far as the spring
// was stretched.
void release_layer(const TickInputs& tick, ProxyLayer& layer, ResidualForce& release) {
  const ToolPose& tool_pose = tick.tool_pose;
  const Vector<Patient> last_spring_mm = (layer.position - tick.tip_before) * layer.stretch_fraction;
  const double remaining_stretch_mm = last_spring_mm.norm() - tick.tip_moved().norm();
  if (const double stiffness = layer.spring_N_per_mm.value_or(0); stiffness > 0 && remaining_stretch_mm > 0) {
    const Vector<Patient> residual_force_N =
        last_spring_mm * (stiffness * remaining_stretch_mm / last_spring_mm.norm());
    const auto contacts = std::span(layer.contacts).first(static_cast<std::size_t>(layer.contact_count));
    const ProxySpheres proxy_spheres(tick.spheres, tool_pose.attitude, layer.attitude);
    release.force_N += residual_force_N;
    release.torque_Nmm += torque_of(contacts, proxy_spheres.spheres(), residual_force_N, stiffness);
    release.stored_mJ += 0.5 * stiffness * remaining_stretch_mm * remaining_stretch_mm;
  }
  const Vector<Patient> displacement = tool_pose.tip - layer.position;
  layer.attitude = tool_pose.attitude;
  if (!layer.coupled || displacement.norm() > kProxySettings.at_rest_mm) {
    layer.position = tool_pose.tip;
    layer.last_displacement = displacement;
  }
  layer.coupled = true;
  layer.sticking = false;
  layer.contact_count = 0;
  layer.stretch_fraction = 1;
  layer.spring_N_per_mm = 0;
  layer.catch_up_mm = layer.stranded_s = 0;
  layer.punctured = still_open(tick.surfaces, tick.spheres, tool_pose, layer);
}

// sum of the spring stiffnesses of layer `first` and all layers within it; those of the last tick for layers
// that have not been advanced in this one
double stiffness_from(const ProxyState& state, int first) {
  double stiffness = 0;
  for (int n = first; n < kMaxLayers; ++n) stiffness += state.layer(n).spring_N_per_mm.value_or(0);
  return stiffness;
}

// adds the force of layer n to the total
void add_layer(int n, const ProxyForce& force, ProxyResult& result) {
  result.of_layer[static_cast<std::size_t>(n)] = force;
  result.force_N += force.force_N;
  result.torque_Nmm += force.torque_Nmm;
  result.stiffness_N_per_mm += force.stiffness_N_per_mm;
  result.tangent_N_per_mm += force.tangent_N_per_mm;
  result.stored_mJ += force.stored_mJ;
  result.deformable = result.deformable || force.deformable;
}

// adds the residual force of released layers to the total
void add_release(const ResidualForce& release, ProxyResult& result) {
  result.release = release;
  result.force_N += release.force_N;
  result.torque_Nmm += release.torque_Nmm;
  result.stored_mJ += release.stored_mJ;
}

}  // namespace

ProxyResult advance_proxy(std::span<const ContactSurface> surfaces, std::span<const ToolSphere> spheres,
                          const ToolPose& tool_pose, ProxyState& state, const ProxyOptions& options,
                          ProxyPath* path) {
  PALPATE_CHECK(surfaces.size() <= kMaxSurfaces && !spheres.empty() && spheres.size() <= kMaxToolSpheres);
  const TickInputs tick{surfaces, spheres, tool_pose, state.tip, options};
  ProxyResult result;
  ContactSprings springs(surfaces, tool_pose.tip, options);
  UpdateWorkspace work;
  SlipBudget slip{options.max_slip_N_per_s * options.dt_s, state.stiffness_N_per_mm};
  slip.remaining_N -= state.release.fade(slip.remaining_N);
  state.tip = tool_pose.tip;
  state.stiffness_N_per_mm = 0;
  // Whether the current layer constrains the tool. The outermost layer does until the tool has returned to
  // free space, an inner layer only while the layer that covers it does.
  bool is_constrained = !has_withdrawn(surfaces, spheres, tool_pose, state);
  if (!is_constrained) state.compliance = {};
  for (int n = 0; n < layer_count(surfaces); ++n) {
    ProxyLayer& layer = state.layer(n);
    ProxyPath* const layer_path = n == 0 ? path : nullptr;
    is_constrained = is_constrained && (n == 0 || !state.layer(n - 1).coupled ||
                                        !coincides_with(state.layer(n - 1), tool_pose));
    if (!is_constrained) {
      release_layer(tick, layer, state.release);
      // the proxy was reset: the path consists of a single vertex
      if (layer_path != nullptr) layer_path->add(layer.position, layer.attitude);
      continue;
    }

    // position of the proxy
    const std::optional<double> before_N_per_mm = layer.spring_N_per_mm;
    const ProxyAdvance advance =
        advance_layer(tick, n, slip.max_slip_mm(), layer, state.cache(n), layer_path, work);
    result.wedged = result.wedged || advance.wedged;
    result.lagging = result.lagging || advance.lagging;
    if (!state.coupled) {
      // no force while the free side of the surfaces is unknown
      state.reset_inner_layers();
      state.release = {};
      springs.recover(state.relaxation);
      return result;
    }

    // force of its spring; only the outermost layer contains deformable structures
    ComplianceState none;
    const ProxySpheres proxy_spheres(spheres, tool_pose.attitude, layer.attitude);
    const bool has_arrived = !advance.lagging && !advance.wedged;
    const ProxyForce force =
        springs.add({layer, proxy_spheres.spheres(), advance.spring, has_arrived, slip.remaining_N},
                    state.cache(n).owners, n == 0 ? state.compliance : none, state.relaxation);
    layer.spring_N_per_mm = force.stiffness_N_per_mm;
    layer.catch_up_mm = layer.contact_count == 0 && advance.lagging ? advance.spring.tool_since_force_mm : 0;
    add_layer(n, force, result);

    // the layers within may use the slip that this layer has not used
    slip.spend(before_N_per_mm, force, advance.spring);
    slip.stiffness_N_per_mm = stiffness_from(state, n + 1);
  }
  if (coincides_with(state, tool_pose)) {
    state.free_tip = tool_pose.tip;
    state.free_attitude = tool_pose.attitude;
  }
  springs.recover(state.relaxation);
  state.release.limit(options.max_force_N);
  state.stiffness_N_per_mm = result.tangent_N_per_mm;
  add_release(state.release, result);
  result.normal = springs.normal();
  result.friction = springs.friction();
  result.tissue_contact = springs.tissue_contact();
  springs.path().report(result);
  result.ruptured = puncture(surfaces, spheres, tool_pose, springs.puncture_forces(), options.holes, state);
  return result;
}

ProxyResult advance_proxy(std::span<const ContactSurface> surfaces, std::span<const ToolSphere> spheres,
                          const ToolPose& tool_pose, ProxyState& state, const ProxyOptions& options) {
  return advance_proxy(surfaces, spheres, tool_pose, state, options, nullptr);
}

}  // namespace palpate
