#include "servo/tool_in_hand.h"

#include <optional>

namespace palpate {
namespace {

std::optional<Burr> burr_of(const TickContext& tick, const HandContext& hand, const MotorState& motor) {
  const Tool& tool = hand.tool;
  if (!tool.burr) return std::nullopt;
  return Burr{tool.radius_mm,
              motor.runs ? tool.burr->revolutions_per_s : 0,
              hand.in_patient(tick, tool.burr->spindle),
              tool.burr->grip,
              motor.most_press_N,
              tick.model.protected_structures,
              motor.stroke,
              tool.burr->length_mm,
              tool.burr->end_radius_mm};
}

// a bit for each layer that has a proxy
unsigned coupled_layers(const ProxyState& proxy) {
  unsigned layers = 0;
  for (int n = 0; n < kMostLayers; ++n) layers |= static_cast<unsigned>(proxy.layer(n).coupled) << n;
  return layers;
}

}  // namespace

ToolContact advance_tool(const TickContext& tick, const HandContext& context, const ProxyChange& change,
                         const MotorState& motor, SessionState::Hand& hand) {
  const std::vector<FeltSurface>& surfaces = tick.model.surfaces;
  HeldTool held(tick, context);
  ProxyState& proxy = hand.proxy;
  const std::optional<Burr> burr = burr_of(tick, context, motor);
  if (burr) {
    if (change.surfaces) settle_burr(surfaces, *burr, held.pose(), change.carved, proxy, hand.burr);
    held.set_first(burr->head(hand.burr.inset_mm));
  }
  const unsigned coupled_before = coupled_layers(proxy);
  if (change.surfaces && change.layers)
    layer_proxy_anew(surfaces, held.spheres(), held.pose(), change.before, proxy);
  else if (change.surfaces)
    keep_proxy(surfaces, held.spheres(), held.pose(), change.before, proxy);
  const bool let_go = coupled_layers(proxy) != coupled_before;
  if (change.method && !proxy.coupled) give_birth_to_proxy(surfaces, held.spheres(), held.pose(), proxy);
  const ProxyOptions options = proxy_options(tick, context);
  const ProxyResult result = burr ? advance_burr(surfaces, *burr, held.pose(), proxy, hand.burr, options)
                                  : advance_proxy(surfaces, held.spheres(), held.pose(), proxy, options);
  if (burr) held.set_first(burr->head(hand.burr.sunk_mm));
  ToolContact contact = touch_by_proxy(tick, context, held, proxy, result, hand.coupling);
  contact.let_go = let_go;
  // the head is where it cuts, or leans on the innermost of what it leans on
  if (burr && hand.burr.layer >= 0 && proxy.layer(hand.burr.layer).coupled)
    contact.strongest.proxy = proxy.layer(hand.burr.layer).position;
  return contact;
}

}  // namespace palpate
