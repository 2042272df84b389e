#include "palpate/tissue/removal.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "palpate/base/check.h"
#include "palpate/tissue/tissue_settings.h"
#include "tissue/burr_head.h"
#include "tissue/material_sampler.h"

namespace palpate {
namespace {

// appends a path to the sweeps, or extends the last one; false if the capacity is exhausted
bool append_sweep(const BurrTool& burr, const HeadPose& from, const HeadPose& to, BurrState& state) {
  const Vector<Patient> axis_mm = burr.head(to.attitude).axis_mm;
  if (state.sweep_count > 0 && !state.sweep_closed) {
    Sweep& last = state.sweep[static_cast<std::size_t>(state.sweep_count - 1)];
    const Sweep longer{last.from, to.at, burr->radius_mm, burr->stroke, axis_mm, last.end_radius_mm};
    if (last.stroke == burr->stroke && (from.at - last.to).norm() <= kCuttingSettings.max_deviation_mm &&
        (to.at - last.from).norm() <= kCuttingSettings.max_sweep_mm &&
        distance_to_path_mm(longer, last.to) <= kCuttingSettings.max_deviation_mm &&
        (axis_mm - state.sweep_start_axis_mm).norm() <= kCuttingSettings.max_turn_mm) {
      last = longer;
      return true;
    }
  }
  if (state.sweep_count == kMaxSweeps) return false;
  state.sweep_start_axis_mm = burr.head(from.attitude).axis_mm;
  state.spent_mJ[static_cast<std::size_t>(state.sweep_count)] = {};
  state.sweep[static_cast<std::size_t>(state.sweep_count++)] = {
      from.at, to.at, burr->radius_mm, burr->stroke, axis_mm, burr.is_ball() ? 0 : burr->end_radius_mm};
  state.sweep_closed = false;
  state.sweep_age_s = 0;
  return true;
}

// largest penetration of a burr with its full radii into the surfaces that its proxies are in contact with
double penetration_mm(std::span<const ContactSurface> surfaces, const BurrTool& burr,
                      const ProxyState& proxy) {
  const double radius_mm = burr->radius_mm;
  double depth_mm = 0;
  for (std::size_t s = 0; s < surfaces.size(); ++s) {
    const ContactSurface& surface = surfaces[s];
    const ProxyLayer& layer = proxy.layer(surface.layer);
    const bool covered =
        surface.covered_by >= 0 && !layer.punctured[static_cast<std::size_t>(surface.covered_by)];
    if (surface.surface == nullptr || !layer.coupled || layer.punctured[s] || covered) continue;
    const ToolPart head = burr.head(layer.attitude);
    if (is_farther(*surface.surface, head, layer.position, radius_mm)) continue;
    const NearestPart nearest = nearest_part(*surface.surface, head, layer.position, radius_mm);
    depth_mm = std::max(depth_mm, radius_mm - nearest.distance_mm);
  }
  return depth_mm;
}

// Maximum clearance error of the head where material was removed, from the interpolated surfaces. It
// decreases towards uncut material, so that the inset is continuous.
double missing_clearance_mm(std::span<const ContactSurface> surfaces, const BurrTool& burr,
                            const ProxyState& proxy) {
  const double radius_mm = burr->radius_mm;
  double largest = 0;
  for (const ContactSurface& surface : surfaces) {
    if (surface.original_surface == nullptr || surface.clearance_error_mm <= largest ||
        !proxy.layer(surface.layer).coupled)
      continue;
    const Point<Patient>& at = proxy.layer(surface.layer).position;
    const ToolPart head = burr.head(proxy.layer(surface.layer).attitude);
    if (is_farther(*surface.original_surface, head, at, radius_mm - largest)) continue;
    const NearestPart nearest = nearest_part(*surface.original_surface, head, at, radius_mm - largest);
    largest = std::max(largest, std::min(surface.clearance_error_mm, radius_mm - nearest.distance_mm));
  }
  return largest;
}

/// Volume removed by a burr that sinks in by a feed: its front area grows with depth as for a ball entering a
/// plane.
class FeedVolume {
 public:
  FeedVolume(double front_mm2, double radius_mm)
      : front_mm2_(front_mm2), grows_mm_(std::numbers::pi * radius_mm) {}

  double volume_mm3(double feed_mm) const { return (front_mm2_ + grows_mm_ * feed_mm) * feed_mm; }
  double feed_mm(double volume_mm3) const {
    const double root = std::sqrt(front_mm2_ * front_mm2_ + 4 * grows_mm_ * volume_mm3);
    return 2 * volume_mm3 / (front_mm2_ + root);
  }

 private:
  double front_mm2_, grows_mm_;
};

// applies motor work to the energy debt; returns the work used
double pay_debt(double work_mJ, BurrState& state) {
  if (!(state.debt_mJ > 0)) return 0;
  const double spent_mJ = std::min(work_mJ, state.debt_mJ);
  state.debt_mJ -= spent_mJ;
  state.work_mJ += spent_mJ;
  state.removed_mm3 += spent_mJ / state.debt_mJ_per_mm3;
  return spent_mJ;
}

// moves a layer's proxy and updates force and stored energy
void move_to(const HeadPose& pose, const Point<Patient>& tip, ProxyLayer& layer, ProxyForce& force,
             ProxyResult& result) {
  const Vector<Patient> force_change_N =
      (pose.at - layer.position) * (layer.stretch_fraction * force.stiffness_N_per_mm);
  layer.position = pose.at;
  layer.attitude = pose.attitude;
  const Vector<Patient> stretched_mm = (layer.position - tip) * layer.stretch_fraction;
  const double stored_mJ = 0.5 * force.stiffness_N_per_mm * stretched_mm.squared_norm();
  result.force_N += force_change_N;
  result.stored_mJ += stored_mJ - force.stored_mJ;
  force.force_N += force_change_N;
  force.stored_mJ = stored_mJ;
}

// Pose of a head after a displacement, corrected so that it enters no protected structure deeper than before:
// moved next to the structure, so that it slides, or back to the start. A slight penetration, as rebuilt
// surfaces can cause, is resolved at recovery_mm per tick.
HeadPose outside_protected(const BurrTool& burr, const HeadPose& from, const HeadPose& to) {
  if (burr->protected_structures.empty()) return to;
  const ToolPart head_before = burr.head(from.attitude), head_after = burr.head(to.attitude);
  Point<Patient> position = to.at;
  for (int n = 0; n < kCuttingSettings.max_iterations; ++n) {
    bool clear = true;
    for (const ProtectedStructure& structure : burr->protected_structures) {
      const Surface& surface = *structure.surface;
      if (!structure.is_protected ||
          is_certainly_beyond(surface, head_after, position, burr->max_radius_mm()))
        continue;
      const NearestPart nearest = nearest_part(surface, head_after, position, burr->radius_mm);
      if (nearest.distance_mm >= burr->radius_mm) continue;
      const double min_mm =
          std::min(burr->radius_mm, nearest_part(surface, head_before, from.at, burr->radius_mm).distance_mm +
                                        kCuttingSettings.recovery_mm);
      const double correction_mm = min_mm - nearest.distance_mm;
      if (correction_mm <= kCuttingSettings.contact_tolerance_mm) continue;
      clear = false;
      position += surface.outward(position + head_after.axis_mm * nearest.axis_fraction) * correction_mm;
    }
    if (clear) return {position, to.attitude};
  }
  return {from.at, burr.is_ball() ? to.attitude : from.attitude};
}

int innermost_touched(const ProxyState& proxy) {
  for (int n = kMaxLayers - 1; n >= 0; --n)
    if (proxy.layer(n).coupled && proxy.layer(n).contact_count > 0) return n;
  return -1;
}

// Motor work of a tick, estimated from the press force and the cutting front of the previous tick.
struct MotorWork {
  MotorWork(const Burr& burr, double dt_s, const BurrState& state)
      : cuts(burr.revolutions_per_s > 0 && !state.sweeps_full),
        in_material(cuts && state.front_mm2 > 0 && std::isfinite(state.energy_mJ_per_mm3)),
        feed_volume(state.front_mm2, burr.max_radius_mm()),
        mJ_per_N(in_material ? burr.grip * state.edge_speed_mm_s * dt_s : 0),
        pressed_N(state.pressed_N),
        mJ_per_mm3(state.energy_mJ_per_mm3) {}

  bool cuts, in_material;
  FeedVolume feed_volume;
  double mJ_per_N, pressed_N, mJ_per_mm3;
};

// Sets the inset that the motor's work of this tick allows.
void update_inset(std::span<const ContactSurface> surfaces, const BurrTool& burr, const MotorWork& motor,
                  const ProxyState& proxy, BurrState& state) {
  state.inset_mm = state.penetration_mm;
  if (motor.in_material) {
    // the energy debt is worked off first
    const double spendable_mJ =
        std::max(0.0, state.unspent_work_mJ + motor.mJ_per_N * motor.pressed_N - state.debt_mJ);
    const double feed_mm = motor.feed_volume.feed_mm(spendable_mJ / motor.mJ_per_mm3);
    state.inset_mm =
        std::min(state.penetration_mm + std::min(feed_mm, kCuttingSettings.max_feed_mm),
                 std::max(state.penetration_mm, kCuttingSettings.max_inset_fraction * burr->min_radius_mm()));
  }
  // a burr that does not cut must be able to leave by the path on which it entered
  if (!motor.cuts) state.inset_mm = std::max(state.inset_mm, missing_clearance_mm(surfaces, burr, proxy));
}

// Poses of the layers' proxies before they are advanced.
struct LayerPoses {
  explicit LayerPoses(const ProxyState& proxy) {
    for (int n = 0; n < kMaxLayers; ++n) {
      pose[static_cast<std::size_t>(n)] = {proxy.layer(n).position, proxy.layer(n).attitude};
      coupled[static_cast<std::size_t>(n)] = proxy.layer(n).coupled;
    }
  }

  std::array<HeadPose, kMaxLayers> pose;
  std::array<bool, kMaxLayers> coupled{};
};

// moves the proxies of all layers that have entered a protected structure out of it
void keep_outside_protected(const BurrTool& burr, const LayerPoses& before, const Point<Patient>& tip,
                            ProxyState& proxy, ProxyResult& result) {
  for (std::size_t n = 0; n < before.pose.size(); ++n) {
    ProxyLayer& layer = proxy.layer(static_cast<int>(n));
    if (burr->protected_structures.empty() || !layer.coupled || !before.coupled[n]) continue;
    const HeadPose pose = outside_protected(burr, before.pose[n], {layer.position, layer.attitude});
    const bool same = pose.at == layer.position && pose.attitude.coeffs() == layer.attitude.coeffs();
    if (!same) move_to(pose, tip, layer, result.of_layer[n], result);
  }
}

// Adds the motor's work of this tick. The proxy does not move for displacements below its resolution: unspent
// work is accumulated, up to the work that advances the burr by max_feed_mm.
void accumulate_work(const Burr& burr, const MotorWork& motor, double force_N, BurrState& state) {
  if (!motor.in_material) return;
  const double now_N = std::min(force_N, burr.max_press_N);
  const double done_mJ = motor.mJ_per_N * 0.5 * (motor.pressed_N + now_N);
  const double work_mJ = done_mJ - pay_debt(done_mJ, state);
  const double unspent_work_mJ =
      std::min(state.unspent_work_mJ + work_mJ,
               motor.mJ_per_mm3 * motor.feed_volume.volume_mm3(kCuttingSettings.max_feed_mm));
  state.work_mJ += std::max(0.0, unspent_work_mJ - state.unspent_work_mJ);
  state.unspent_work_mJ = std::max(state.unspent_work_mJ, unspent_work_mJ);
}

// Cuts the material between the poses of the touched layer's proxy before and after this tick, as far as the
// motor's work and the capacity for sweeps allow, and limits the displacement of all layers accordingly.
void cut_along_path(std::span<const ContactSurface> surfaces, const BurrTool& burr, const LayerPoses& before,
                    const Point<Patient>& tip, ProxyState& proxy, BurrState& state, ProxyResult& result) {
  const ProxyLayer& layer = proxy.layer(state.layer);
  const HeadPose from = before.pose[static_cast<std::size_t>(state.layer)],
                 to{layer.position, layer.attitude};
  const Vector<Patient> moved = to.at - from.at;
  const Vector<Patient> turned = burr.head(to.attitude).axis_mm - burr.head(from.attitude).axis_mm;
  const HeadDisplacement displacement(moved, moved + turned);
  if (!(displacement.length_mm > kCuttingSettings.at_rest_mm)) return;
  const HeadPose middle = burr.interpolate(from, to, 0.5);
  const MaterialSampler between(surfaces, burr, burr.head(middle.attitude), layer, state.layer, middle.at,
                                state);
  CuttingFront swept = between.along(displacement);
  if (!(swept.area_mm2 > 0)) swept = between.thin_contact_front(layer, displacement);
  const double cost_mJ = swept.area_mm2 * displacement.length_mm * swept.energy_mJ_per_mm3;
  if (!(swept.area_mm2 > 0 && std::isfinite(cost_mJ))) return;
  double fraction = std::min(1.0, state.unspent_work_mJ / cost_mJ);
  const HeadPose there = outside_protected(burr, from, burr.interpolate(from, to, fraction));
  state.sweeps_full = fraction > 0 && !append_sweep(burr, from, there, state);
  if (state.sweeps_full) fraction = 0;
  // all layers represent one burr: none may move ahead of the one that cuts
  for (std::size_t n = 0; n < before.pose.size(); ++n) {
    ProxyLayer& layered = proxy.layer(static_cast<int>(n));
    if (!layered.coupled || layered.contact_count == 0) continue;
    const HeadPose pose = burr.interpolate(before.pose[n], {layered.position, layered.attitude}, fraction);
    move_to(outside_protected(burr, before.pose[n], pose), tip, layered, result.of_layer[n], result);
  }
  state.removed_mm3 += swept.area_mm2 * displacement.length_mm * fraction;
  state.unspent_work_mJ -= cost_mJ * fraction;
  if (fraction > 0) {
    auto& spent_mJ = state.spent_mJ[static_cast<std::size_t>(state.sweep_count - 1)];
    spent_mJ[kThin] += cost_mJ * fraction * swept.thin_fraction;
    spent_mJ[kThick] += cost_mJ * fraction * (1 - swept.thin_fraction);
  }
}

// Samples the material ahead of the burr in the direction in which it is pressed, for the next tick.
void sample_front(std::span<const ContactSurface> surfaces, const BurrTool& burr, const ProxyState& proxy,
                  const Vector<Patient>& force_N, BurrState& state) {
  const Vector<Patient> push = force_N * -1.0;
  if (!(push.norm() > 0)) return;
  const ProxyLayer& layer = proxy.layer(state.layer);
  const MaterialSampler ahead(surfaces, burr, burr.head(layer.attitude), layer, state.layer, layer.position,
                              state);
  CuttingFront front = ahead.along({push, push});
  if (!(front.area_mm2 > 0)) front = ahead.edge_contact_front(layer);
  if (!(front.area_mm2 > 0)) front = ahead.thin_contact_front(layer, {push, push});
  state.front_mm2 = front.area_mm2;
  state.edge_speed_mm_s = front.edge_speed_mm_s;
  state.energy_mJ_per_mm3 = front.energy_mJ_per_mm3;
}

}  // namespace

ToolPart Burr::head(double inset_mm) const {
  if (!(length_mm > 0)) return {Vector<Patient>(), radius_mm - inset_mm};
  // sample spacing independent of the inset: otherwise the head might not fit where it has just been
  return {Vector<Patient>(), radius_mm - inset_mm, axis * length_mm, end_radius_mm - radius_mm,
          0.5 * min_radius_mm()};
}
double Burr::min_radius_mm() const {
  return length_mm > 0 ? std::min(radius_mm, end_radius_mm) : radius_mm;
}
double Burr::max_radius_mm() const {
  return length_mm > 0 ? std::max(radius_mm, end_radius_mm) : radius_mm;
}

void settle_burr(const CarvedMaterial& carved, BurrState& state) {
  const std::uint64_t end =
      std::min(carved.sweeps, state.first_sweep + static_cast<std::uint64_t>(state.sweep_count));
  if (end <= state.first_sweep) return;
  constexpr std::array kUncharged_mm3{kCuttingSettings.thick_uncharged_mm3,
                                      kCuttingSettings.thin_uncharged_mm3};
  constexpr std::array kCredited_mm3{kCuttingSettings.thick_credited_mm3, kCuttingSettings.thin_credited_mm3};
  for (std::size_t bone = 0; bone < kBoneClasses; ++bone) {
    double& balance_mJ = state.balance_mJ[bone];
    const double mJ = carved.energy_mJ[bone] - state.settled.energy_mJ[bone];
    const double mm3 = carved.volume_mm3[bone] - state.settled.volume_mm3[bone];
    balance_mJ += mJ;
    for (std::size_t n = 0; n < end - state.first_sweep; ++n) balance_mJ -= state.spent_mJ[n][bone];
    if (mm3 > 0) state.debt_mJ_per_mm3 = mJ / mm3;
    balance_mJ = std::max(balance_mJ, -kCredited_mm3[bone] * state.debt_mJ_per_mm3);
    if (balance_mJ <= kUncharged_mm3[bone] * state.debt_mJ_per_mm3) continue;
    state.debt_mJ += balance_mJ;
    balance_mJ = 0;
  }
  state.settled = carved;
}

ProxyResult advance_burr(std::span<const ContactSurface> surfaces, const Burr& burr,
                         const ToolPose& tool_pose, ProxyState& proxy, BurrState& state,
                         const ProxyOptions& options) {
  const BurrTool burr_tool(burr, tool_pose);
  state.sweep_age_s += options.dt_s;
  if (state.sweep_age_s >= kCuttingSettings.max_sweep_s) state.sweep_closed = true;
  // After a reset of the proxy, sweeps made so far are still to be carved but are not extended.
  if (!proxy.layer(std::max(state.layer, 0)).coupled) {
    state.penetration_mm = state.pressed_N = state.front_mm2 = 0;
    state.layer = -1;
    state.sweep_closed = true;
  }
  const MotorWork motor(burr, options.dt_s, state);
  update_inset(surfaces, burr_tool, motor, proxy, state);
  if (!(burr.revolutions_per_s > 0)) state.sweep_closed = true;

  const int layer_before = state.layer;
  const LayerPoses before(proxy);
  const ToolPart head = burr.head(state.inset_mm);
  // the motor's work limits the displacement, not the slip rate
  ProxyOptions guided = options;
  guided.max_slip_N_per_s = std::numeric_limits<double>::infinity();
  if (motor.cuts) guided.max_distance_increase = kCuttingSettings.max_distance_increase;
  ProxyResult result = advance_proxy(surfaces, {&head, 1}, tool_pose, proxy, guided);
  keep_outside_protected(burr_tool, before, tool_pose.tip, proxy, result);
  state.penetration_mm = std::min(state.inset_mm, penetration_mm(surfaces, burr_tool, proxy));
  // a burr that has sunk in is in material even without a contact
  const int touched = innermost_touched(proxy);
  if (touched >= 0 || !(state.penetration_mm > 0)) state.layer = touched;

  state.front_mm2 = 0;
  if (state.layer < 0 || !motor.cuts) {
    state.pressed_N = std::min(result.force_N.norm(), burr.max_press_N);
    state.unspent_work_mJ = 0;
    return result;
  }
  accumulate_work(burr, motor, result.force_N.norm(), state);
  if (layer_before == state.layer)
    cut_along_path(surfaces, burr_tool, before, tool_pose.tip, proxy, state, result);
  state.pressed_N = std::min(result.force_N.norm(), burr.max_press_N);
  state.penetration_mm = std::min(state.inset_mm, penetration_mm(surfaces, burr_tool, proxy));
  if (burr.model != nullptr && burr.model->thin_voxels != nullptr) ++state.thin_ticks;
  sample_front(surfaces, burr_tool, proxy, result.force_N, state);
  return result;
}

void rebase_burr(std::span<const ContactSurface> surfaces, const Burr& burr, const ToolPose& tool_pose,
                 std::uint64_t carved, const ProxyState& proxy, BurrState& state) {
  const auto removed = static_cast<int>(std::min<std::uint64_t>(
      carved > state.first_sweep ? carved - state.first_sweep : 0, state.sweep_count));
  std::move(state.sweep.begin() + removed, state.sweep.begin() + state.sweep_count, state.sweep.begin());
  std::move(state.spent_mJ.begin() + removed, state.spent_mJ.begin() + state.sweep_count,
            state.spent_mJ.begin());
  state.first_sweep += static_cast<std::uint64_t>(removed);
  state.sweep_count -= removed;
  if (removed > 0) state.sweeps_full = false;
  const double depth_mm = penetration_mm(surfaces, BurrTool(burr, tool_pose), proxy);
  const bool fits = depth_mm > 0 && depth_mm + kCuttingSettings.surface_error_mm < burr.min_radius_mm();
  state.penetration_mm = state.inset_mm = fits ? depth_mm + kCuttingSettings.surface_error_mm : 0;
}

std::uint64_t finished_sweeps(const BurrState& state) {
  const bool grows = state.sweep_count > 0 && !state.sweep_closed;
  return state.first_sweep + static_cast<std::uint64_t>(state.sweep_count) - (grows ? 1 : 0);
}

std::vector<Cut> finished_cuts(const BurrState& state, std::uint32_t device) {
  std::vector<Cut> cuts;
  for (const Sweep& sweep : finished_from(state, state.first_sweep)) cuts.push_back({device, sweep});
  return cuts;
}

std::span<const Sweep> finished_from(const BurrState& state, std::uint64_t number) {
  const std::uint64_t finished = finished_sweeps(state);
  PALPATE_CHECK(number >= state.first_sweep && number <= finished);
  return state.pending().subspan(static_cast<std::size_t>(number - state.first_sweep),
                                 static_cast<std::size_t>(finished - number));
}

}  // namespace palpate
