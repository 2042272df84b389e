#include "palpate/tissue/removal.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "palpate/base/check.h"

namespace palpate {
namespace {

// It looks for material so far before its surface. Half of that deep, an edge begins to count, so that beside
// a pocket, where its surface comes out of the material, little counts that it does not touch.
constexpr double kAhead_mm = 0.1;
// Directions ahead, spread evenly over the disc that the burr is from ahead.
constexpr int kDirections = 64;
// It sinks in by no more in a tick, and while the surfaces are not made by no more than a part of its radius.
constexpr double kMostFeed_mm = 0.1, kMostInsetPart = 0.8;
// Ways that bend by less, and are no longer, are one sweep.
constexpr double kStraight_mm = 0.002, kLongest_mm = 0.25;
// Less of a way is none.
constexpr double kStill_mm = 1e-6;

/// The material right before a burr, as seen along a way.
struct Front {
  double area_mm2 = 0;
  double edge_mm_per_s = 0;      // mean over it
  double energy_mJ_per_mm3 = 0;  // mean over it
};

class Ahead {
 public:
  /// @param at  of the burr, in a layer
  Ahead(std::span<const FeltSurface> surfaces, const Burr& burr, const ProxyLayer& layer, int number,
        const Point<Patient>& at, const BurrState& state)
      : surfaces_(surfaces), burr_(burr), at_(at), state_(state) {
    const double near_mm = burr.radius_mm + kAhead_mm;
    for (std::size_t s = 0; s < surfaces.size() && count_ < near_.size(); ++s) {
      const FeltSurface& felt = surfaces[s];
      const bool covered = felt.beneath >= 0 && !layer.punctured[static_cast<std::size_t>(felt.beneath)];
      if (felt.layer != number || felt.surface == nullptr || layer.punctured[s] || covered) continue;
      if (felt.surface->is_beyond(at_, near_mm) && felt.surface->outside_mm() > 0) continue;
      if (felt.surface->at_least_mm(at_) > near_mm) continue;
      near_[count_++] = static_cast<int>(s);
    }
  }

  /// @param way  unit
  Front along(const Vector<Patient>& way) const {
    Front front;
    if (count_ == 0) return front;
    const Vector<Patient> side = perpendicular(way), up = way.cross(side);
    const double share_mm2 = std::numbers::pi * burr_.radius_mm * burr_.radius_mm / kDirections;
    double speed = 0, energy = 0;
    for (int n = 0; n < kDirections; ++n) {
      // Vogel's spiral: so many places, evenly over a disc
      const double r = std::sqrt((n + 0.5) / kDirections), turn = n * kGoldenAngle;
      const Vector<Patient> direction =
          way * std::sqrt(1 - r * r) + side * (r * std::cos(turn)) + up * (r * std::sin(turn));
      const Material material = before(direction);
      if (!(material.part > 0)) continue;
      const double area_mm2 = share_mm2 * material.part;
      front.area_mm2 += area_mm2;
      speed += area_mm2 * burr_.axis.cross(direction).norm();
      energy += area_mm2 * material.energy;
    }
    if (!(front.area_mm2 > 0)) return {};
    const double turns_mm_per_s = 2 * std::numbers::pi * burr_.revolutions_per_s * burr_.radius_mm;
    front.edge_mm_per_s = turns_mm_per_s * speed / front.area_mm2;
    front.energy_mJ_per_mm3 = energy / front.area_mm2;
    return front;
  }

 private:
  struct Material {
    double part = 0;    // 0 ... 1, of an edge in that direction
    double energy = 0;  // mJ/mm3
  };
  Material before(const Vector<Patient>& direction) const {
    const Point<Patient> place = at_ + direction * (burr_.radius_mm + kAhead_mm);
    double least_mm = std::numeric_limits<double>::infinity();
    int surface = -1;
    for (std::size_t n = 0; n < count_; ++n) {
      const double distance_mm = surfaces_[static_cast<std::size_t>(near_[n])].surface->distance_mm(place);
      if (distance_mm < least_mm) {
        least_mm = distance_mm;
        surface = near_[n];
      }
    }
    if (!(least_mm < 0)) return {};
    for (const Sweep& sweep : state_.pending())
      least_mm = std::max(least_mm, sweep.radius_mm - distance_to_axis_mm(sweep, place));
    if (!(least_mm < 0)) return {};
    double cut = 0, energy = 0;  // shares of what is not kept
    for (const OwnerShare& share : owners_at(surfaces_, surface, place).all()) {
      const FeltSurface& structure = surfaces_[static_cast<std::size_t>(share.structure)];
      if (structure.kept) continue;
      cut += share.part;
      energy += share.part * structure.cutting_energy_mJ_per_mm3;
    }
    if (!(cut > 0)) return {};
    return {cut * std::clamp(-2 * least_mm / kAhead_mm - 1, 0.0, 1.0), energy / cut};
  }
  static Vector<Patient> perpendicular(const Vector<Patient>& to) {
    const Eigen::Vector3d away = to.eigen().cwiseAbs();
    int least = 0;
    away.minCoeff(&least);
    return to.cross(Vector<Patient>(Eigen::Vector3d::Unit(least))).normalized();
  }

  static constexpr double kGoldenAngle = 2 * std::numbers::pi * (2 - std::numbers::phi);
  std::span<const FeltSurface> surfaces_;
  const Burr& burr_;
  const Point<Patient> at_;
  const BurrState& state_;
  std::array<int, 8> near_{};
  std::size_t count_ = 0;
};

// adds a way to what was swept; false where there is no room
bool sweep(const Point<Patient>& from, const Point<Patient>& to, const Burr& burr, BurrState& state) {
  if (state.sweeps > 0 && !state.closed) {
    Sweep& last = state.sweep[static_cast<std::size_t>(state.sweeps - 1)];
    const Sweep longer{last.from, to, burr.radius_mm, burr.stroke};
    if (last.stroke == burr.stroke && (from - last.to).norm() <= kStraight_mm &&
        (to - last.from).norm() <= kLongest_mm && distance_to_axis_mm(longer, last.to) <= kStraight_mm) {
      last = longer;
      return true;
    }
  }
  if (state.sweeps == static_cast<int>(state.sweep.size())) return false;
  state.sweep[static_cast<std::size_t>(state.sweeps++)] = {from, to, burr.radius_mm, burr.stroke};
  state.closed = false;
  state.open_s = 0;
  return true;
}

// how far a burr of its whole radius lies in what its proxies lean on
double sunk_mm(std::span<const FeltSurface> surfaces, double radius_mm, const ProxyState& proxy) {
  double sunk = 0;
  for (std::size_t s = 0; s < surfaces.size(); ++s) {
    const FeltSurface& felt = surfaces[s];
    const ProxyLayer& layer = proxy.layer(felt.layer);
    const bool covered = felt.beneath >= 0 && !layer.punctured[static_cast<std::size_t>(felt.beneath)];
    if (felt.surface == nullptr || !layer.coupled || layer.punctured[s] || covered) continue;
    if (felt.surface->at_least_mm(layer.position) >= radius_mm) continue;
    sunk = std::max(sunk, radius_mm - felt.surface->distance_mm(layer.position));
  }
  return sunk;
}

// by how much it may not fit where something was taken, as the surfaces are read there: less towards what was
// not, so that nothing jumps
double short_mm(std::span<const FeltSurface> surfaces, double radius_mm, const ProxyState& proxy) {
  double most = 0;
  for (const FeltSurface& felt : surfaces) {
    if (felt.made == nullptr || felt.short_mm <= most || !proxy.layer(felt.layer).coupled) continue;
    const Point<Patient>& at = proxy.layer(felt.layer).position;
    if (felt.made->at_least_mm(at) >= radius_mm - most) continue;
    most = std::max(most, std::min(felt.short_mm, radius_mm - felt.made->distance_mm(at)));
  }
  return most;
}

/// What a burr takes that sinks in by so much: its front grows as it does, as in a plane.
class Sinking {
 public:
  Sinking(double front_mm2, double radius_mm)
      : front_mm2_(front_mm2), grows_mm_(std::numbers::pi * radius_mm) {}

  double volume_mm3(double feed_mm) const { return (front_mm2_ + grows_mm_ * feed_mm) * feed_mm; }
  double feed_mm(double volume_mm3) const {
    const double root = std::sqrt(front_mm2_ * front_mm2_ + 4 * grows_mm_ * volume_mm3);
    return 2 * volume_mm3 / (front_mm2_ + root);
  }

 private:
  double front_mm2_, grows_mm_;
};

// puts a layer's proxy elsewhere
void move_to(const Point<Patient>& place, const Point<Patient>& tip, ProxyLayer& layer, ProxyForce& force,
             ProxyResult& result) {
  const Vector<Patient> more_N = (place - layer.position) * (layer.part * force.stiffness_N_per_mm);
  layer.position = place;
  const Vector<Patient> stretched_mm = (layer.position - tip) * layer.part;
  const double stored_mJ = 0.5 * force.stiffness_N_per_mm * stretched_mm.squared_norm();
  result.force_N += more_N;
  result.stored_mJ += stored_mJ - force.stored_mJ;
  force.force_N += more_N;
  force.stored_mJ = stored_mJ;
}

// Where a ball that has gone from one place to another is put so that it comes no deeper into what is kept
// than it was: beside it, so that it slides, or where it was. One that lies in it a little, because surfaces
// are not the same to a hair, comes out slowly.
Point<Patient> beside_kept(const Burr& burr, const Point<Patient>& from, const Point<Patient>& to) {
  constexpr int kMostTries = 4;
  constexpr double kTouching_mm = 1e-4, kRegained_mm = 1e-3;
  Point<Patient> place = to;
  for (int n = 0; n < kMostTries; ++n) {
    bool clear = true;
    for (const ProtectedStructure& structure : burr.spared) {
      const Surface& kept = *structure.surface;
      if (!structure.kept || kept.is_beyond(place, burr.radius_mm)) continue;
      const double least_mm = std::min(burr.radius_mm, kept.distance_mm(from) + kRegained_mm);
      const double in_mm = least_mm - kept.distance_mm(place);
      if (in_mm <= kTouching_mm) continue;
      clear = false;
      place += kept.outward(place) * in_mm;
    }
    if (clear) return place;
  }
  return from;
}

int innermost_touched(const ProxyState& proxy) {
  for (int n = kMostLayers - 1; n >= 0; --n)
    if (proxy.layer(n).coupled && proxy.layer(n).contacts > 0) return n;
  return -1;
}

}  // namespace

ProxyResult advance_burr(std::span<const FeltSurface> surfaces, const Burr& burr, const ToolPose& hand,
                         ProxyState& proxy, BurrState& state, const ProxyOptions& options) {
  state.open_s += options.dt_s;
  if (state.open_s >= kLongestSweep_s) state.closed = true;
  // a proxy that was let go comes anew: what the burr has swept is still to be carved, and no more of it goes
  // on
  if (!proxy.layer(std::max(state.layer, 0)).coupled) {
    state.sunk_mm = state.pressed_N = state.front_mm2 = 0;
    state.layer = -1;
    state.closed = true;
  }
  // how far the burr may sink in by what the motor works in this tick, as far as is known before it
  const bool cuts = burr.revolutions_per_s > 0 && !state.full;
  const bool in_material = cuts && state.front_mm2 > 0 && std::isfinite(state.energy_mJ_per_mm3);
  const Sinking sinking(state.front_mm2, burr.radius_mm);
  const double mJ_per_N = in_material ? burr.grip * state.edge_mm_per_s * options.dt_s : 0;
  const double pressed_N = state.pressed_N, energy = state.energy_mJ_per_mm3;
  state.inset_mm = state.sunk_mm;
  if (in_material) {
    const double feed_mm = sinking.feed_mm((state.spare_mJ + mJ_per_N * pressed_N) / state.energy_mJ_per_mm3);
    state.inset_mm = std::min(state.sunk_mm + std::min(feed_mm, kMostFeed_mm),
                              std::max(state.sunk_mm, kMostInsetPart * burr.radius_mm));
  }
  // a burr that cuts makes its way; one that does not is to come out where it went in
  if (!cuts) state.inset_mm = std::max(state.inset_mm, short_mm(surfaces, burr.radius_mm, proxy));
  if (!(burr.revolutions_per_s > 0)) state.closed = true;

  const int was_in = state.layer;
  std::array<Point<Patient>, kMostLayers> before;
  std::array<bool, kMostLayers> was_coupled{};
  for (int n = 0; n < kMostLayers; ++n) {
    before[static_cast<std::size_t>(n)] = proxy.layer(n).position;
    was_coupled[static_cast<std::size_t>(n)] = proxy.layer(n).coupled;
  }
  const ToolSphere ball{Vector<Patient>(), burr.radius_mm - state.inset_mm};
  ProxyResult result = advance_proxy(surfaces, {&ball, 1}, hand, proxy, options);
  for (std::size_t n = 0; n < before.size(); ++n) {
    ProxyLayer& layer = proxy.layer(static_cast<int>(n));
    if (burr.spared.empty() || !layer.coupled || !was_coupled[n]) continue;
    const Point<Patient> place = beside_kept(burr, before[n], layer.position);
    if (place != layer.position) move_to(place, hand.tip, layer, result.of_layer[n], result);
  }
  state.sunk_mm = std::min(state.inset_mm, sunk_mm(surfaces, burr.radius_mm, proxy));
  // where it has sunk in it is in material, pressed or not
  const int touched = innermost_touched(proxy);
  if (touched >= 0 || !(state.sunk_mm > 0)) state.layer = touched;
  const int is_in = state.layer;

  state.front_mm2 = 0;
  if (is_in < 0 || !cuts) {
    state.pressed_N = std::min(result.force_N.norm(), burr.most_press_N);
    state.spare_mJ = 0;
    return result;
  }
  // a proxy does not follow every thousandth of a millimetre: work that is not used yet is kept, but for what
  // would carry it farther in one tick than it may go
  if (in_material) {
    const double now_N = std::min(result.force_N.norm(), burr.most_press_N);
    const double work_mJ = mJ_per_N * 0.5 * (pressed_N + now_N);
    const double spare_mJ = std::min(state.spare_mJ + work_mJ, energy * sinking.volume_mm3(kMostFeed_mm));
    state.work_mJ += std::max(0.0, spare_mJ - state.spare_mJ);
    state.spare_mJ = std::max(state.spare_mJ, spare_mJ);
  }
  const ProxyLayer& layer = proxy.layer(is_in);
  const Point<Patient> from = before[static_cast<std::size_t>(is_in)];
  const Vector<Patient> moved = layer.position - from;
  const double way_mm = moved.norm();
  if (was_in == is_in && way_mm > kStill_mm) {
    const Front swept = Ahead(surfaces, burr, layer, is_in, from + moved * 0.5, state).along(moved / way_mm);
    const double cost_mJ = swept.area_mm2 * way_mm * swept.energy_mJ_per_mm3;
    if (swept.area_mm2 > 0 && std::isfinite(cost_mJ)) {
      // through material it comes no farther than the motor has worked for, and than can be remembered
      double part = std::min(1.0, state.spare_mJ / cost_mJ);
      const Point<Patient> to = beside_kept(burr, from, from + moved * part);
      state.full = part > 0 && !sweep(from, to, burr, state);
      if (state.full) part = 0;
      // the layers are one burr: none goes ahead of the one that cuts
      for (std::size_t n = 0; n < before.size(); ++n) {
        ProxyLayer& held = proxy.layer(static_cast<int>(n));
        if (!held.coupled || held.contacts == 0) continue;
        const Point<Patient> place = before[n] + (held.position - before[n]) * part;
        move_to(beside_kept(burr, before[n], place), hand.tip, held, result.of_layer[n], result);
      }
      state.taken_mm3 += swept.area_mm2 * way_mm * part;
      state.spare_mJ -= cost_mJ * part;
    }
  }
  state.pressed_N = std::min(result.force_N.norm(), burr.most_press_N);
  state.sunk_mm = std::min(state.inset_mm, sunk_mm(surfaces, burr.radius_mm, proxy));

  const Ahead ahead(surfaces, burr, layer, is_in, layer.position, state);
  const Vector<Patient> push = result.force_N * -1.0;
  if (!(push.norm() > 0)) return result;
  const Front front = ahead.along(push.normalized());
  state.front_mm2 = front.area_mm2;
  state.edge_mm_per_s = front.edge_mm_per_s;
  state.energy_mJ_per_mm3 = front.energy_mJ_per_mm3;
  return result;
}

void settle_burr(std::span<const FeltSurface> surfaces, const Burr& burr, std::uint64_t carved,
                 const ProxyState& proxy, BurrState& state) {
  const auto gone = static_cast<int>(
      std::min<std::uint64_t>(carved > state.first ? carved - state.first : 0, state.sweeps));
  std::move(state.sweep.begin() + gone, state.sweep.begin() + state.sweeps, state.sweep.begin());
  state.first += static_cast<std::uint64_t>(gone);
  state.sweeps -= gone;
  if (gone > 0) state.full = false;
  // a surface is read from between its voxels: it may be a little nearer than it was cut
  constexpr double kRounding_mm = 1e-4;
  const double sunk = sunk_mm(surfaces, burr.radius_mm, proxy);
  const bool fits = sunk > 0 && sunk + kRounding_mm < burr.radius_mm;
  state.sunk_mm = state.inset_mm = fits ? sunk + kRounding_mm : 0;
}

std::uint64_t finished_sweeps(const BurrState& state) {
  const bool grows = state.sweeps > 0 && !state.closed;
  return state.first + static_cast<std::uint64_t>(state.sweeps) - (grows ? 1 : 0);
}

std::vector<Cut> finished_cuts(const BurrState& state, std::uint32_t device) {
  std::vector<Cut> cuts;
  for (const Sweep& sweep : finished_from(state, state.first)) cuts.push_back({device, sweep});
  return cuts;
}

std::span<const Sweep> finished_from(const BurrState& state, std::uint64_t number) {
  const std::uint64_t finished = finished_sweeps(state);
  PALPATE_CHECK(number >= state.first && number <= finished);
  return state.pending().subspan(static_cast<std::size_t>(number - state.first),
                                 static_cast<std::size_t>(finished - number));
}

}  // namespace palpate
