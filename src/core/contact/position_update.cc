#include "contact/position_update.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <span>

#include "contact/blocked_proxy.h"
#include "contact/substep.h"

namespace palpate {
namespace {

// Reach of push_out(): number of projection steps times their maximum length. It is used when a proxy starts
// inside a surface, e.g. after a change to a larger tool.
constexpr double kMaxPushOut_mm = kProxySettings.max_corrections * kProxySettings.substep_mm();

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
  const double segment_mm = layer.contact_count == 0
                                ? progress.remaining_beyond_segment_mm
                                : std::min(progress.remaining_beyond_segment_mm, kProxySettings.gathering_mm);
  work.pairs.gather(in.surfaces, in.parts, in.layer, layer.punctured, layer.position,
                    segment_mm + kProxySettings.substep_mm());
  work.friction.clear();
  progress.max_gradient = work.pairs.max_gradient();
  // the segment is shortened to the reach of the set of pairs, which is less than segment_mm where the set is
  // full
  progress.remaining_in_segment_mm = std::min(segment_mm, work.pairs.reach_mm());
  progress.remaining_beyond_segment_mm -= progress.remaining_in_segment_mm;
}

// Pushes a proxy that starts inside surfaces out of them, at most by kMaxPushOut_mm, and gathers again at the
// new position. Returns false if there is no position outside within that distance.
bool push_out(const UpdateInputs& in, ProxyLayer& layer, UpdateProgress& progress, UpdateWorkspace& work) {
  work.pairs.gather(in.surfaces, in.parts, in.layer, layer.punctured, layer.position, kMaxPushOut_mm);
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
  const auto cached = cache.at_rest.find(layer.position, layer.punctured, in.parts);
  if (cached.empty()) return false;
  work.pairs.clear();
  work.friction.clear();
  for (const RestingContacts::Constraint& one : cached) {
    const ContactSurface& surface = in.surfaces[static_cast<std::size_t>(one.surface)];
    const ToolPart& part = in.parts[static_cast<std::size_t>(one.part)];
    const std::size_t index = work.pairs.count();
    const ContactPair& pair = work.pairs.add_cached({surface.surface.get(), one.surface, one.part, part, 0});
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
    cached[n] = {half_space.normal, half_space.offset, pair.index, pair.part, std::nullopt};
    if (const Friction* friction = work.friction.find(work.pairs.index_of(pair)))
      cached[n].friction = *friction;
  }
  cache.at_rest.store(layer.position, layer.punctured, in.parts,
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

}  // namespace

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

}  // namespace palpate
