#include "palpate/contact/proxy.h"

#include <algorithm>
#include <optional>
#include <span>

#include "contact/capsule_row.h"
#include "contact/contact_springs.h"
#include "contact/force_continuity.h"
#include "contact/near_surfaces.h"
#include "contact/position_update.h"
#include "contact/proxy_parts.h"
#include "contact/puncture.h"
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
///    proxy is at rest or a work limit of the tick is reached (position_update.h).
/// 6. Force: a spring from the tip to the proxy, whose stretch and stiffness are rate-limited
///    (contact_springs.h), and puncture of each structure whose share of the spring force exceeds its
///    puncture force (puncture.h).
namespace palpate {
namespace {

/// Inputs of a tick that all layers share.
struct TickInputs {
  std::span<const ContactSurface> surfaces;
  std::span<const ToolPart> parts;  ///< Tool parts in the operator's attitude
  const ToolPose& tool_pose;
  Point<Patient> tip_before;  ///< Tip position of the last tick
  const ProxyOptions& options;

  Vector<Patient> tip_moved() const { return tool_pose.tip - tip_before; }
};

/// Result of advancing one layer's proxy by one tick.
struct ProxyAdvance {
  bool wedged = false, lagging = false;  ///< As in ProxyResult
  SpringMotion spring;
};

// rotates and moves one layer's proxy
ProxyAdvance advance_layer(const TickInputs& tick, int n, double max_slip_mm, ProxyLayer& layer,
                           ProxyLayerCache& cache, ProxyPath* path, UpdateWorkspace& work) {
  const std::span<const ContactSurface> surfaces = tick.surfaces;
  const std::span<const ToolPart> parts = tick.parts;
  const Point<Patient>& tip = tick.tool_pose.tip;
  ProxyAdvance result;
  if (!layer.coupled) {
    if (!is_free(surfaces, parts, n, {}, {}, tip)) return result;
    layer = {};
    cache.at_rest.invalidate();
    layer.coupled = true;
    layer.position = tip;
    layer.attitude = tick.tool_pose.attitude;
  }
  layer.punctured = still_open(surfaces, parts, tick.tool_pose, layer);

  // rotation
  const Eigen::Quaterniond attitude_before = layer.attitude;
  const Vector<Patient> tip_moved = tick.tip_moved();
  result.spring.last_spring_mm = (layer.position - (tip - tip_moved)) * layer.stretch_fraction;
  const ToolTurn turn = turn_tool(surfaces, parts, n, tick.tool_pose.attitude, layer, path);
  const ProxyParts proxy_spheres(parts, tick.tool_pose.attitude, layer.attitude);
  const double turned_mm = arc_of_rotation_mm(parts, attitude_before, layer.attitude);

  // Position. Without contact the path may be as long as the distance to the tip; in contact its length per
  // tick is limited.
  const double to_tip_mm = (tip - layer.position).norm() + kProxySettings.slack_mm;
  const double max_mm =
      layer.contact_count == 0 ? to_tip_mm : std::min(to_tip_mm, kProxySettings.max_path_mm);
  const DisplacementBall limit = limit_displacement(layer, tip_moved, turned_mm, max_slip_mm);
  result.spring.tool_mm = tip_moved.norm() + turned_mm;
  result.spring.tool_since_force_mm = layer.catch_up_mm + result.spring.tool_mm;
  result.spring.max_change_mm = limit.radius_mm;
  const bool capsules = has_capsules(parts);
  const double max_distance_increase = capsules ? std::min(tick.options.max_distance_increase,
                                                           kProxySettings.max_distance_increase_of_capsules)
                                                : tick.options.max_distance_increase;
  const PositionUpdate update =
      update_position({surfaces, proxy_spheres.parts(), n, tip, max_mm, limit, result.spring.last_spring_mm,
                       tick.options.friction, capsules, max_distance_increase, path},
                      layer, cache, work);

  // A proxy is reset to a tip in free space at once if it is inside surfaces, and after lost_s if it has
  // stopped far from the tip without a contact.
  const bool is_far =
      !update.lagging && !turn.lagging && (tip - layer.position).norm() > kProxySettings.lost_mm;
  const bool is_stranded = layer.contact_count == 0 && (update.inside || is_far) &&
                           is_free(surfaces, parts, n, layer.punctured, {}, tip);
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
    const ProxyParts proxy_spheres(tick.parts, tool_pose.attitude, layer.attitude);
    release.force_N += residual_force_N;
    release.torque_Nmm += torque_of(contacts, proxy_spheres.parts(), residual_force_N, stiffness);
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
  layer.punctured = still_open(tick.surfaces, tick.parts, tool_pose, layer);
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

ProxyResult advance_proxy(std::span<const ContactSurface> surfaces, std::span<const ToolPart> parts,
                          const ToolPose& tool_pose, ProxyState& state, const ProxyOptions& options,
                          ProxyPath* path) {
  PALPATE_CHECK(surfaces.size() <= kMaxSurfaces && !parts.empty() && parts.size() <= kMaxToolParts);
  const TickInputs tick{surfaces, parts, tool_pose, state.tip, options};
  ProxyResult result;
  ContactSprings springs(surfaces, tool_pose.tip, options);
  UpdateWorkspace work;
  SlipBudget slip{options.max_slip_N_per_s * options.dt_s, state.stiffness_N_per_mm};
  slip.remaining_N -= state.release.fade(slip.remaining_N);
  state.tip = tool_pose.tip;
  state.stiffness_N_per_mm = 0;
  // Whether the current layer constrains the tool. The outermost layer does until the tool has returned to
  // free space, an inner layer only while the layer that covers it does.
  bool is_constrained = !has_withdrawn(surfaces, parts, tool_pose, state);
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
    const ProxyParts proxy_spheres(parts, tool_pose.attitude, layer.attitude);
    const bool has_arrived = !advance.lagging && !advance.wedged;
    const ProxyForce force =
        springs.add({layer, proxy_spheres.parts(), advance.spring, has_arrived, slip.remaining_N},
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
  result.ruptured = puncture(surfaces, parts, tool_pose, springs.puncture_forces(), options.holes, state);
  return result;
}

ProxyResult advance_proxy(std::span<const ContactSurface> surfaces, std::span<const ToolPart> parts,
                          const ToolPose& tool_pose, ProxyState& state, const ProxyOptions& options) {
  return advance_proxy(surfaces, parts, tool_pose, state, options, nullptr);
}

}  // namespace palpate
