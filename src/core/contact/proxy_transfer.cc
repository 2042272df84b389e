#include <algorithm>

#include "contact/near_surfaces.h"
#include "contact/puncture.h"
#include "palpate/contact/proxy.h"

/// Start of contact inside tissue, and transfer of a contact to a changed set of surfaces.
namespace palpate {
namespace {

// transfer_proxy() for one layer
void transfer_layer(std::span<const ContactSurface> surfaces, std::span<const ToolPart> parts, int layer,
                    std::span<const SurfaceCorrespondence> correspondences, ProxyLayer& state,
                    ProxyLayerCache& cache) {
  const ProxyLayer old = state;
  cache.at_rest.invalidate();
  SurfaceSet same, punctured;
  for (std::size_t s = 0; s < correspondences.size(); ++s) {
    same[s] = correspondences[s].is_unchanged;
    punctured[s] = correspondences[s].index >= 0 &&
                   old.punctured[static_cast<std::size_t>(correspondences[s].index)] &&
                   surfaces[s].surface != nullptr && surfaces[s].layer == layer;
  }
  if (!old.coupled || !is_free(surfaces, parts, layer, punctured, same, old.position)) {
    state = {};
    state.position = old.position;
    return;
  }

  // remaps contacts to the new indices; contacts with surfaces that no longer exist are dropped
  state.punctured = punctured;
  state.spring_N_per_mm.reset();
  state.contact_count = 0;
  for (const ProxyContact& contact :
       std::span(old.contacts).first(static_cast<std::size_t>(old.contact_count))) {
    const auto now =
        std::find_if(correspondences.begin(), correspondences.end(),
                     [&](const SurfaceCorrespondence& one) { return one.index == contact.surface; });
    if (now == correspondences.end()) continue;
    ProxyContact& transferred = state.contacts[static_cast<std::size_t>(state.contact_count++)];
    transferred = contact;
    transferred.surface = static_cast<int>(now - correspondences.begin());
  }
  state.sticking = old.sticking && state.contact_count > 0;
}

// initialises a layer's proxy for a tip that is inside tissue
// @param punctured  surfaces that the tool has punctured
bool initialise_layer(std::span<const ContactSurface> surfaces, std::span<const ToolPart> parts, int layer,
                      const ToolPose& tool_pose, const SurfaceSet& punctured, ProxyLayer& state,
                      ProxyLayerCache& cache) {
  // the first search reaches as far as the distance fields; other surfaces may be nearer at its result
  Point<Patient> position = tool_pose.tip;
  const auto is_out = [&] { return is_free(surfaces, parts, layer, punctured, {}, position); };
  for (int search = 0; search < kProxySettings.max_initial_searches && !is_out(); ++search) {
    PairSet pairs(surfaces, parts, layer, punctured, position, kProxySettings.initial_reach_mm);
    if (!project_out(pairs, kProxySettings.max_initial_steps, kProxySettings.initial_reach_mm, position))
      return false;
  }
  if (!is_out()) return false;
  cache.at_rest.invalidate();
  state = {};
  state.coupled = true;
  state.punctured = punctured;
  state.position = position;
  state.attitude = tool_pose.attitude;
  return true;
}

}  // namespace

void transfer_proxy(std::span<const ContactSurface> surfaces, std::span<const ToolPart> parts,
                    const ToolPose& tool_pose, std::span<const SurfaceCorrespondence> correspondences,
                    ProxyState& state) {
  PALPATE_CHECK(surfaces.size() <= kMaxSurfaces &&
                (correspondences.empty() || correspondences.size() == surfaces.size()));
  for (int n = 0; n < kMaxLayers; ++n) {
    ProxyLayer& layer = state.layer(n);
    transfer_layer(surfaces, RotatedTool(parts, tool_pose.attitude, layer.attitude).parts(), n,
                   correspondences, layer, state.cache(n));
  }
}

bool initialise_proxy(std::span<const ContactSurface> surfaces, std::span<const ToolPart> parts,
                      const ToolPose& tool_pose, ProxyState& state) {
  ProxyState initial;
  for (int n = 0; n < layer_count(surfaces); ++n)
    if (!initialise_layer(surfaces, parts, n, tool_pose, {}, initial.layer(n), initial.cache(n)) && n == 0)
      return false;
  initial.free_tip = initial.position;
  initial.free_attitude = initial.attitude;
  state = initial;
  return true;
}

void transfer_proxy_to_new_layers(std::span<const ContactSurface> surfaces, std::span<const ToolPart> parts,
                                  const ToolPose& tool_pose,
                                  std::span<const SurfaceCorrespondence> correspondences, ProxyState& state) {
  PALPATE_CHECK(surfaces.size() <= kMaxSurfaces &&
                (correspondences.empty() || correspondences.size() == surfaces.size()));
  SurfaceSet through;
  for (std::size_t s = 0; s < correspondences.size(); ++s)
    for (int n = 0; n < kMaxLayers && correspondences[s].index >= 0; ++n)
      through[s] = through[s] || state.layer(n).punctured[static_cast<std::size_t>(correspondences[s].index)];
  const bool was_coupled = state.coupled;
  transfer_layer(surfaces, RotatedTool(parts, tool_pose.attitude, state.attitude).parts(), 0, correspondences,
                 state, state.cache(0));
  state.reset_inner_layers();
  state.compliance = {};
  state.relaxation = {};
  // the side from which the tip entered was unknown
  if (!was_coupled) return;
  state.punctured = {};
  for (std::size_t s = 0; s < surfaces.size(); ++s)
    if (through[s]) open_structure(surfaces, static_cast<int>(s), state);
  for (int n = state.coupled ? 1 : 0; n < layer_count(surfaces); ++n) {
    const SurfaceSet punctured = state.layer(n).punctured;
    const bool initialised =
        initialise_layer(surfaces, parts, n, tool_pose, punctured, state.layer(n), state.cache(n));
    if (!initialised || n > 0) continue;
    state.free_tip = state.position;
    state.free_attitude = state.attitude;
  }
}

}  // namespace palpate
