#include "servo/tool_tick.h"

#include <algorithm>
#include <optional>

#include "palpate/contact/no_go.h"
#include "palpate/device/rendered_stiffness.h"

namespace palpate {
namespace {

// the tool's burr in its current pose, rotating if the motor runs; empty if the tool is no burr
std::optional<Burr> burr_of(const TickContext& tick, const DeviceContext& context, const MotorState& motor) {
  const Tool& tool = context.tool;
  if (!tool.burr) return std::nullopt;
  return Burr{tool.radius_mm,
              motor.runs ? tool.burr->revolutions_per_s : 0,
              context.in_patient(tick, tool.burr->spindle),
              tool.burr->grip,
              motor.max_press_N,
              tick.model.protected_structures,
              motor.stroke,
              &tick.model,
              tool.burr->length_mm,
              tool.burr->end_radius_mm};
}

// bit n: layer n is coupled
unsigned coupled_layers(const ProxyState& proxy) {
  unsigned layers = 0;
  for (int n = 0; n < kMaxLayers; ++n) layers |= static_cast<unsigned>(proxy.layer(n).coupled) << n;
  return layers;
}

}  // namespace

ToolContact advance_tool(const TickContext& tick, const DeviceContext& context, const ProxyChange& change,
                         const MotorState& motor, SessionState::DeviceSession& session) {
  const std::vector<ContactSurface>& surfaces = tick.model.surfaces;
  PosedTool posed_tool(tick, context);
  ProxyState& proxy = session.proxy;
  const std::optional<Burr> burr = burr_of(tick, context, motor);
  if (burr) {
    if (change.surfaces_changed) {
      settle_burr(change.carved, session.burr);
      rebase_burr(surfaces, *burr, posed_tool.pose(), change.carved.sweeps, proxy, session.burr);
    }
    posed_tool.set_first(burr->head(session.burr.inset_mm));
  }
  const unsigned coupled_before = coupled_layers(proxy);
  if (change.surfaces_changed && change.layers_reassigned)
    transfer_proxy_to_new_layers(surfaces, posed_tool.parts(), posed_tool.pose(), change.correspondences,
                                 proxy);
  else if (change.surfaces_changed)
    transfer_proxy(surfaces, posed_tool.parts(), posed_tool.pose(), change.correspondences, proxy);
  const bool released = coupled_layers(proxy) != coupled_before;
  if (change.was_pushed_directly && !proxy.coupled)
    initialise_proxy(surfaces, posed_tool.parts(), posed_tool.pose(), proxy);
  const ProxyOptions options = proxy_options(tick, context);
  const ProxyResult result =
      burr ? advance_burr(surfaces, *burr, posed_tool.pose(), proxy, session.burr, options)
           : advance_proxy(surfaces, posed_tool.parts(), posed_tool.pose(), proxy, options);
  if (burr) posed_tool.set_first(burr->head(session.burr.penetration_mm));
  ToolContact contact = touch_by_proxy(tick, context, posed_tool, proxy, result, session.coupling);
  contact.released = released;
  // the proxy reported for a burr is that of the innermost layer in contact, or of the layer into which it
  // has cut
  if (burr && session.burr.layer >= 0 && proxy.layer(session.burr.layer).coupled)
    contact.strongest.proxy = proxy.layer(session.burr.layer).position;
  return contact;
}

void add_no_go_force(const TickContext& tick, const DeviceContext& context, ToolContact& contact,
                     DeviceTick& out) {
  const Model& model = tick.model;
  if (model.no_go.empty() && model.distance_trees.structures().empty()) return;
  PosedTool posed_tool(tick, context);
  if (const auto burr = burr_of(tick, context, {})) posed_tool.set_first(burr->head(0));

  // structures near the tool
  const auto near = nearest_structures(model.distance_trees, posed_tool.parts(), context.tip);
  for (std::size_t n = 0; n < near.size(); ++n) {
    out.near_label[n] = near[n].label;
    out.near_mm[n] = near[n].distance_mm;
  }

  // force of the no-go regions
  const NoGoForce push = no_go_force(model.no_go, model.distance_trees, posed_tool.parts(), context.tip,
                                     context.max_stiffness_N_per_mm());
  if (push.region < 0) return;
  out.flags |= kFlagNoGo;
  out.no_go = static_cast<std::uint16_t>(push.region + 1);
  out.no_go_depth_mm = push.depth_mm;
  const DeviceParameters& gains = context.device;
  const Vector<World> force_N = tick.X_WorldPatient * push.force_N * gains.force_gain;
  const double all_N = force_N.norm();
  if (!(all_N > 0)) return;
  // contact force in the direction of the push, and the fraction of the push that is still missing
  const double provided_N = std::max(0.0, contact.requested.force_N.dot(force_N) / all_N);
  const double missing_fraction = std::max(0.0, all_N - provided_N) / all_N;
  // patient N mm to device N mm, for torque and energy
  const double device_work_ratio = gains.force_gain / gains.scale;
  contact.requested.force_N += force_N * missing_fraction;
  contact.requested.torque_Nmm +=
      tick.X_WorldPatient * push.torque_Nmm * (device_work_ratio * missing_fraction);
  // the full energy of the push, an upper bound like the contact's stored energy
  contact.stored_mJ += push.stored_mJ * device_work_ratio;
  contact.stiffness_N_per_mm =
      std::max(contact.stiffness_N_per_mm, RenderedStiffness(gains).at_device(push.stiffness_N_per_mm));
  out.no_go_N = all_N * missing_fraction;
}

}  // namespace palpate
