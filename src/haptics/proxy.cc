#include "palpate/proxy.h"

#include <algorithm>
#include <cmath>

#include "haptics/half_spaces.h"
#include "palpate/proxy_way.h"

namespace palpate {
namespace {

// nearer than this a surface is a wall: then it has a half-space, before it a clearance
constexpr double kSkin_mm = 0.05;
// what a stride along surfaces may end below one, before it is put back onto it
constexpr double kDip_mm = 0.008;
// A stride along surfaces. Between two ends that lie at most kDip_mm below, a surface as steep as a distance
// can rise by half a stride.
constexpr double kStride_mm = 2 * (kMostDip_mm - kDip_mm) - 0.004;
// shorter ways are none, and so little below is outside
constexpr double kStill_mm = 2e-5, kOutside_mm = 1e-5;
constexpr int kMostStrides = 48, kMostTries = 4, kMostHalvings = 8, kMostCorrections = 8;
// how far the proxy goes along surfaces in a tick, and beyond the tip's own way
constexpr double kMostWay_mm = 3, kSlack_mm = 0.2;
// how far surfaces that the tool has turned into push it
constexpr double kMostPush_mm = kMostCorrections * kStride_mm;
// walls whose normals are as near as this do the same work
constexpr double kParallel = 0.999, kBeside_mm = 0.02;
// A stride that leads away from the tip by more than this part of itself is not taken: normals that are
// smoother than the surface ask for less. What it leads away is energy that nobody put in: a tenth kept a
// light grip swinging over an edge.
constexpr double kAway = 0.02;
// pairs of a sphere and a surface that one tick looks at; more than these near at once, as in no tissue, and
// the proxy goes no farther than the others allow
constexpr std::size_t kMostNear = 32;
// a tool that has gone through a surface is out of it when it has left it by so much
constexpr double kSealed_mm = 0.2;

/// A sphere of the tool and a surface that it may meet in this tick.
struct Near {
  const Surface* surface;
  int index, sphere;
  Vector<Patient> offset_mm;
  double radius_mm;

  /// Negative: below the surface. In the surface's own measure of distance.
  double clearance(const Point<Patient>& proxy) const {
    return surface->distance_mm(proxy + offset_mm) - radius_mm;
  }
  Vector<Patient> outward(const Point<Patient>& proxy) const { return surface->outward(proxy + offset_mm); }
};

/// What is known of a pair's clearance: it falls no faster than its surface is steep.
struct Known {
  Point<Patient> at;
  double clearance_mm = 0;
};

class NearSurfaces {
 public:
  /// Those that the proxy can reach from `at` on a way of `reach_mm`. Where they are too many, the way is as
  /// long as the nearest ones allow.
  NearSurfaces(std::span<const FeltSurface> surfaces, std::span<const ToolSphere> spheres,
               const SurfaceSet& punctured, const Point<Patient>& at, double reach_mm) {
    for (std::size_t s = 0; s < surfaces.size(); ++s) {
      if (punctured[s]) continue;
      const Surface& surface = *surfaces[s].surface;
      for (std::size_t k = 0; k < spheres.size(); ++k) {
        Near near{&surface, static_cast<int>(s), static_cast<int>(k), spheres[k].offset_mm,
                  spheres[k].radius_mm};
        const double clearance_mm = near.clearance(at);
        if (clearance_mm <= reach_mm * surface.steepest()) insert(near, clearance_mm / surface.steepest());
      }
    }
    for (std::size_t n = 0; n < count_; ++n)
      known_[n] = {at, clearances_mm_[n] * near_[n].surface->steepest()};
    reach_mm_ = std::max(0.0, std::min(reach_mm, left_out_mm_));
  }

  std::size_t count() const { return count_; }
  const Near& operator[](std::size_t n) const { return near_[n]; }
  double reach_mm() const { return reach_mm_; }

  /// The clearance of pair n, or, where that is cheaper to know, a lower bound of it above `enough_mm`.
  double clearance(std::size_t n, const Point<Patient>& proxy,
                   double enough_mm = std::numeric_limits<double>::infinity()) {
    Known& known = known_[n];
    const double moved_mm = (proxy - known.at).norm();
    const double at_least_mm = known.clearance_mm - moved_mm * near_[n].surface->steepest();
    if (moved_mm == 0) return known.clearance_mm;
    if (at_least_mm > enough_mm) return at_least_mm;
    known = {proxy, near_[n].clearance(proxy)};
    return known.clearance_mm;
  }

 private:
  // in order of clearance, so that the nearest ones are kept
  void insert(const Near& near, double clearance_mm) {
    if (count_ == kMostNear)
      left_out_mm_ = std::min(left_out_mm_, std::max(clearance_mm, clearances_mm_.back()));
    std::size_t place = count_;
    while (place > 0 && clearances_mm_[place - 1] > clearance_mm) --place;
    if (place == kMostNear) return;
    count_ = std::min(count_ + 1, kMostNear);
    for (std::size_t n = count_ - 1; n > place; --n) {
      near_[n] = near_[n - 1];
      clearances_mm_[n] = clearances_mm_[n - 1];
    }
    near_[place] = near;
    clearances_mm_[place] = clearance_mm;
  }

  std::array<Near, kMostNear> near_;
  std::array<double, kMostNear> clearances_mm_{};
  std::array<Known, kMostNear> known_;
  std::size_t count_ = 0;
  double left_out_mm_ = std::numeric_limits<double>::infinity();
  double reach_mm_ = 0;
};

/// Half-spaces with what they belong to.
class Walls {
 public:
  bool full() const { return count_ == kMostHalfSpaces; }
  void clear() { count_ = 0; }
  /// The tangent plane at a place whose clearance is known: the surface lies that much farther along it.
  /// False where there is no direction, or no room.
  bool add(const Near& near, const Point<Patient>& at, double clearance_mm) {
    const Vector<Patient> normal = near.outward(at);
    if (normal == Vector<Patient>()) return false;
    const HalfSpace wall{normal, normal.eigen().dot(at.eigen()) - clearance_mm};
    const std::size_t place = full() ? place_of_weaker(wall) : count_++;
    if (place == kMostHalfSpaces) return false;
    half_spaces_[place] = wall;
    near_[place] = &near;
    return true;
  }
  std::size_t count() const { return count_; }
  std::span<const HalfSpace> half_spaces() const { return {half_spaces_.data(), count_}; }
  const HalfSpace& half_space(std::size_t n) const { return half_spaces_[n]; }
  const Near& near(std::size_t n) const { return *near_[n]; }

 private:
  // one that does the same work and leaves more room, or none
  std::size_t place_of_weaker(const HalfSpace& wall) const {
    std::size_t n = 0;
    while (n < kMostHalfSpaces &&
           !(half_spaces_[n].normal.dot(wall.normal) > kParallel && half_spaces_[n].offset < wall.offset))
      ++n;
    return n;
  }

  std::array<HalfSpace, kMostHalfSpaces> half_spaces_;
  std::array<const Near*, kMostHalfSpaces> near_{};
  std::size_t count_ = 0;
};

// Puts a place back outside every surface that it lies a little below, in steps of so much at most: walls
// that nearly face each other would send it far away. False where there is no such place near.
bool leave_surfaces(NearSurfaces& near, int most_steps, double step_mm, Point<Patient>& proxy) {
  Walls walls;
  Point<Patient> outside = proxy;
  for (int n = 0; n <= most_steps; ++n) {
    walls.clear();
    double deepest_mm = 0;
    for (std::size_t i = 0; i < near.count(); ++i) {
      const double clearance_mm = near.clearance(i, outside, 0);
      deepest_mm = std::min(deepest_mm, clearance_mm);
      if (clearance_mm < 0) walls.add(near[i], outside, clearance_mm);
    }
    if (deepest_mm > -kOutside_mm) {
      proxy = outside;
      return true;
    }
    const auto nearest = closest_point(outside, walls.half_spaces());
    if (!nearest) return false;
    const Vector<Patient> way = nearest->point - outside;
    outside += way * std::min(1.0, step_mm / way.norm());
  }
  return false;
}

/// The proxy's way in one tick.
class Walk {
 public:
  /// @param most_mm  how far it goes: `near` looks farther, by what a turn of the tool may push
  /// @param way      gets every corner of it; may be null
  Walk(std::span<const FeltSurface> surfaces, NearSurfaces& near, double most_mm, const Point<Patient>& tip,
       ProxyState& state, const ProxyOptions& options, ProxyWay* way)
      : surfaces_(surfaces),
        options_(options),
        near_(near),
        left_mm_(most_mm),
        tip_(tip),
        state_(state),
        proxy_(state.position),
        anchor_(state.position),
        last_way_(state.last_way),
        anchored_(state.contacts > 0),
        way_(way) {
    for (std::size_t n = 0; n < near.count(); ++n)
      steepest_ = std::max(steepest_, near[n].surface->steepest());
  }

  void go(ProxyResult& result) {
    // the tool may have turned into a surface while its tip stood
    if (!leave_surfaces(near_, kMostCorrections, stride_mm(), proxy_)) {
      result.wedged = true;
      state_.contacts = 0;
      return;
    }
    note(proxy_);
    int stride = 0;
    while (stride < kMostStrides && left_mm_ > 0 && step(result)) ++stride;
    result.lagging = stride == kMostStrides || left_mm_ <= 0;
    state_.position = proxy_;
    state_.last_way = last_way_;
  }

 private:
  // one stride; false when the proxy has come to rest
  bool step(ProxyResult& result) {
    const double free_mm = touch_what_is_near();
    // a try that fails has let nothing go: the next one is held as the proxy was before
    const bool sticking = state_.sticking, anchored = anchored_;
    for (int attempt = 0; attempt < kMostTries; ++attempt) {
      state_.sticking = sticking;
      anchored_ = anchored;
      const auto nearest = closest_point(tip_, walls_.half_spaces());
      if (!nearest) {
        result.wedged = true;
        return false;
      }
      const Point<Patient> goal = with_friction(*nearest);
      remember(*nearest);
      if ((goal - proxy_).norm() <= kStill_mm) return false;
      const Point<Patient> end = towards(goal, walls_.count() == 0 ? free_mm : stride_mm());
      // a wall that was not seen from here holds from now on
      if (add_walls_below(end)) continue;
      return go_to(end);
    }
    state_.sticking = sticking;
    anchored_ = anchored;
    return creep();
  }

  double stride_mm() const { return kStride_mm / steepest_; }

  // The goal, or as far towards it as a stride may go; half of it where the last one went the other way, as
  // it does where the surface is hollow and bends more than the tip is deep.
  Point<Patient> towards(const Point<Patient>& goal, double most_mm) const {
    const Vector<Patient> way = goal - proxy_;
    const double length_mm = way.norm();
    double part = std::min(1.0, std::min(most_mm, left_mm_) / length_mm);
    if (walls_.count() > 0 && way.dot(last_way_) < 0) part *= 0.5;
    return part < 1 ? proxy_ + way * part : goal;
  }

  // There, and back onto surfaces. A stride that leads away from the tip is not taken: so the proxy comes to
  // rest where walls bend within a stride.
  bool go_to(const Point<Patient>& end) {
    Point<Patient> there = end;
    if (!leave_surfaces(near_, kMostCorrections, stride_mm(), there)) return false;
    // what comes in several steps is no way whose ends bound what lies between
    if ((there - end).norm() > stride_mm()) return false;
    const Vector<Patient> way = there - proxy_;
    if ((tip_ - there).norm() > (tip_ - proxy_).norm() + kAway * way.norm()) return false;
    left_mm_ -= std::max((end - proxy_).norm(), way.norm());
    proxy_ = there;
    last_way_ = way;
    note(end);
    note(there);
    return way.norm() > kStill_mm;
  }

  void note(const Point<Patient>& corner) {
    if (way_ != nullptr) way_->add(corner);
  }

  // walls that bend faster than a stride can follow: shorter ones
  bool creep() {
    const auto nearest = closest_point(tip_, walls_.half_spaces());
    if (!nearest) return false;
    Vector<Patient> stride = towards(with_friction(*nearest), stride_mm()) - proxy_;
    for (int halving = 0; halving < kMostHalvings; ++halving) {
      stride = stride * 0.5;
      const Point<Patient> end = proxy_ + stride;
      if (!is_below(end)) return go_to(end);
    }
    return false;
  }

  // half-spaces of everything that is touched; the clearance of the rest
  double touch_what_is_near() {
    walls_.clear();
    double free_mm = std::numeric_limits<double>::infinity();
    for (std::size_t n = 0; n < near_.count(); ++n) {
      const double clearance_mm = near_.clearance(n, proxy_, kSkin_mm);
      if (clearance_mm <= kSkin_mm) walls_.add(near_[n], proxy_, clearance_mm);
    }
    if (walls_.count() == 0) free_mm = free_way_mm();
    if (walls_.count() > 0 && !anchored_) {
      anchor_ = proxy_;
      anchored_ = true;
      state_.sticking = false;
    }
    return free_mm;
  }

  // how far no surface lies
  double free_way_mm() {
    double free_mm = std::numeric_limits<double>::infinity();
    for (std::size_t n = 0; n < near_.count(); ++n) {
      // of one that is touched where it has no direction, half of what is left
      const double clearance_mm = near_.clearance(n, proxy_);
      const double leaves_mm = std::max({0.0, clearance_mm - 0.5 * kSkin_mm, 0.5 * clearance_mm});
      free_mm = std::min(free_mm, leaves_mm / near_[n].surface->steepest());
    }
    return free_mm;
  }

  bool is_below(const Point<Patient>& end) {
    for (std::size_t n = 0; n < near_.count(); ++n)
      if (near_.clearance(n, end, -kDip_mm) < -kDip_mm) return true;
    return false;
  }

  // whether the end of a stride lies below a surface, whose tangent plane there is then a wall
  bool add_walls_below(const Point<Patient>& end) {
    bool below = false;
    for (std::size_t n = 0; n < near_.count(); ++n) {
      const double clearance_mm = near_.clearance(n, end, -kDip_mm);
      if (clearance_mm >= -kDip_mm) continue;
      walls_.add(near_[n], end, clearance_mm);
      below = true;
    }
    return below;
  }

  // Where on the walls friction lets the proxy go: it is dragged behind the place that would be nearest to
  // the tip, from where it was held, as far as the cone allows.
  Point<Patient> with_friction(const ClosestPoint& nearest) {
    if (nearest.count == 0) anchored_ = false;
    if (nearest.count == 0 || !options_.friction) {
      state_.sticking = false;
      return nearest.point;
    }
    double still = 0, sliding = 0, all_mm = 0;
    for (int n = 0; n < nearest.count; ++n) {
      const double pull_mm = nearest.pull_mm[static_cast<std::size_t>(n)];
      const FeltSurface& felt = surface_of(nearest.active[static_cast<std::size_t>(n)]);
      still += pull_mm * felt.static_friction;
      sliding += pull_mm * felt.dynamic_friction;
      all_mm += pull_mm;
    }
    // a wall's pull is the depth; in a corner the way is shorter than the pulls
    const double depth_mm = (nearest.point - tip_).norm();
    const Vector<Patient> behind = along_walls(anchor_ - nearest.point, nearest);
    const double behind_mm = behind.norm();
    state_.sticking = behind_mm <= (state_.sticking ? still : sliding) / all_mm * depth_mm;
    if (state_.sticking) return nearest.point + behind;
    return nearest.point + behind * (sliding / all_mm * depth_mm / behind_mm);
  }

  // without what the walls' normals take
  Vector<Patient> along_walls(const Vector<Patient>& way, const ClosestPoint& nearest) const {
    if (nearest.count == 3) return {};
    const Vector<Patient>& first = walls_.half_space(static_cast<std::size_t>(nearest.active[0])).normal;
    if (nearest.count == 1) return way - first * first.dot(way);
    const Vector<Patient>& second = walls_.half_space(static_cast<std::size_t>(nearest.active[1])).normal;
    const Vector<Patient> edge = first.cross(second).normalized();
    return edge * edge.dot(way);
  }

  // the contacts; walls that do the same work as one that holds share its pull, as two spheres on a plane do
  void remember(const ClosestPoint& nearest) {
    state_.contacts = 0;
    for (int n = 0; n < nearest.count; ++n) {
      const HalfSpace& held = walls_.half_space(static_cast<std::size_t>(nearest.active[n]));
      std::array<double, kMostHalfSpaces> weight{};
      double all = 0;
      for (std::size_t w = 0; w < walls_.count(); ++w) {
        const HalfSpace& wall = walls_.half_space(w);
        const double clearance_mm = wall.clearance(nearest.point);
        if (wall.normal.dot(held.normal) < kParallel || clearance_mm >= kBeside_mm) continue;
        all += weight[w] = 1 - std::max(0.0, clearance_mm) / kBeside_mm;
      }
      for (std::size_t w = 0; w < walls_.count(); ++w)
        if (weight[w] > 0) add_contact(w, nearest.pull_mm[static_cast<std::size_t>(n)] * weight[w] / all);
    }
  }

  void add_contact(std::size_t wall, double pull_mm) {
    if (state_.contacts == static_cast<int>(kMostContacts)) return;
    const Near& near = walls_.near(wall);
    state_.contact[static_cast<std::size_t>(state_.contacts++)] = {near.index, near.sphere,
                                                                   walls_.half_space(wall).normal, pull_mm};
  }

  const FeltSurface& surface_of(int wall) const {
    return surfaces_[static_cast<std::size_t>(walls_.near(static_cast<std::size_t>(wall)).index)];
  }

  std::span<const FeltSurface> surfaces_;
  const ProxyOptions options_;
  NearSurfaces& near_;
  double left_mm_;
  double steepest_ = 1;
  const Point<Patient> tip_;
  ProxyState& state_;
  Point<Patient> proxy_;
  Point<Patient> anchor_;  // where friction holds it
  Vector<Patient> last_way_;
  bool anchored_;
  Walls walls_;
  ProxyWay* way_;
};

bool is_free(std::span<const FeltSurface> surfaces, std::span<const ToolSphere> spheres,
             const SurfaceSet& but, const Point<Patient>& at) {
  for (std::size_t s = 0; s < surfaces.size(); ++s) {
    if (but[s]) continue;
    for (const ToolSphere& sphere : spheres)
      if (surfaces[s].surface->distance_mm(at + sphere.offset_mm) < sphere.radius_mm - kOutside_mm)
        return false;
  }
  return true;
}

// Surfaces that tip and proxy have left close again: the tip may have come out of a layer below while the
// proxy is held within it.
SurfaceSet still_open(std::span<const FeltSurface> surfaces, std::span<const ToolSphere> spheres,
                      const Point<Patient>& tip, const ProxyState& state) {
  SurfaceSet punctured = state.punctured;
  for (std::size_t s = 0; s < surfaces.size(); ++s) {
    if (!punctured[s]) continue;
    const bool left = std::all_of(spheres.begin(), spheres.end(), [&](const ToolSphere& sphere) {
      const double sealed_mm = sphere.radius_mm + kSealed_mm;
      return surfaces[s].surface->distance_mm(tip + sphere.offset_mm) > sealed_mm &&
             surfaces[s].surface->distance_mm(state.position + sphere.offset_mm) > sealed_mm;
    });
    if (left) punctured[s] = false;
  }
  return punctured;
}

// what the spring from the tip to the proxy gives, and through which surfaces it goes
void pull(std::span<const FeltSurface> surfaces, std::span<const ToolSphere> spheres,
          const Point<Patient>& tip, const ProxyOptions& options, ProxyState& state, ProxyResult& result) {
  const std::span<const ProxyContact> contacts{state.contact.data(),
                                               static_cast<std::size_t>(state.contacts)};
  double all_mm = 0, stiffness = 0, own_stiffness = 0;
  for (const ProxyContact& contact : contacts) {
    const double own = surfaces[static_cast<std::size_t>(contact.surface)].stiffness_N_per_mm;
    all_mm += contact.pull_mm;
    own_stiffness += contact.pull_mm * own;
    stiffness += contact.pull_mm * std::min(own, options.most_stiffness_N_per_mm);
  }
  if (!(all_mm > 0)) return;
  stiffness /= all_mm;
  own_stiffness /= all_mm;
  result.stiffness_N_per_mm = stiffness;
  result.force_N = (state.position - tip) * stiffness;

  // what the walls do not give is friction, which acts where they do
  Vector<Patient> along = result.force_N;
  for (const ProxyContact& contact : contacts) along -= contact.normal * (contact.pull_mm * stiffness);
  for (const ProxyContact& contact : contacts) {
    const ToolSphere& sphere = spheres[static_cast<std::size_t>(contact.sphere)];
    const Vector<Patient> arm_mm = sphere.offset_mm - contact.normal * sphere.radius_mm;
    const Vector<Patient> force_N =
        contact.normal * (contact.pull_mm * stiffness) + along * (contact.pull_mm / all_mm);
    result.torque_Nmm += arm_mm.cross(force_N);
    // a proxy that has not arrived is no measure of what the hand presses
    const bool arrived = !result.lagging && !result.wedged;
    if (arrived &&
        contact.pull_mm * own_stiffness > surfaces[static_cast<std::size_t>(contact.surface)].puncture_N) {
      state.punctured[static_cast<std::size_t>(contact.surface)] = true;
      result.ruptured = true;
    }
  }
}

}  // namespace

ProxyResult advance_proxy(std::span<const FeltSurface> surfaces, std::span<const ToolSphere> spheres,
                          const Point<Patient>& tip, ProxyState& state, const ProxyOptions& options,
                          ProxyWay* way) {
  PALPATE_CHECK(surfaces.size() <= kMostSurfaces && !spheres.empty() && spheres.size() <= kMostToolSpheres);
  ProxyResult result;
  if (!state.coupled) {
    if (!is_free(surfaces, spheres, {}, tip)) return result;
    state = {};
    state.coupled = true;
    state.position = tip;
  }
  state.punctured = still_open(surfaces, spheres, tip, state);

  // from free space it comes as far as the tip went; on a surface it is not led farther than a hand goes
  const double to_tip_mm = (tip - state.position).norm() + kSlack_mm;
  const double most_mm = state.contacts == 0 ? to_tip_mm : std::min(to_tip_mm, kMostWay_mm);
  NearSurfaces near(surfaces, spheres, state.punctured, state.position, most_mm + kMostPush_mm);
  Walk(surfaces, near, std::min(most_mm, near.reach_mm()), tip, state, options, way).go(result);
  // lost by a turn of the tool, found again where the tip is free
  if (result.wedged && state.contacts == 0 && is_free(surfaces, spheres, state.punctured, tip))
    state.position = tip;
  pull(surfaces, spheres, tip, options, state, result);
  return result;
}

ProxyResult advance_proxy(std::span<const FeltSurface> surfaces, std::span<const ToolSphere> spheres,
                          const Point<Patient>& tip, ProxyState& state, const ProxyOptions& options) {
  return advance_proxy(surfaces, spheres, tip, state, options, nullptr);
}

void keep_proxy(std::span<const FeltSurface> surfaces, std::span<const ToolSphere> spheres,
                std::span<const SurfaceBefore> before, ProxyState& state) {
  PALPATE_CHECK(surfaces.size() <= kMostSurfaces && (before.empty() || before.size() == surfaces.size()));
  const ProxyState old = state;
  SurfaceSet same, punctured;
  for (std::size_t s = 0; s < before.size(); ++s) {
    same[s] = before[s].same;
    punctured[s] = before[s].index >= 0 && old.punctured[static_cast<std::size_t>(before[s].index)];
  }
  if (!old.coupled || !is_free(surfaces, spheres, same | punctured, old.position)) {
    state = {};
    state.position = old.position;
    return;
  }

  // what it leans on, in the places of now; what is not felt any more is let go
  state.punctured = punctured;
  state.contacts = 0;
  for (const ProxyContact& contact : std::span(old.contact).first(static_cast<std::size_t>(old.contacts))) {
    const auto now = std::find_if(before.begin(), before.end(),
                                  [&](const SurfaceBefore& one) { return one.index == contact.surface; });
    if (now == before.end()) continue;
    ProxyContact& kept = state.contact[static_cast<std::size_t>(state.contacts++)];
    kept = contact;
    kept.surface = static_cast<int>(now - before.begin());
  }
  state.sticking = old.sticking && state.contacts > 0;
}

bool give_birth_to_proxy(std::span<const FeltSurface> surfaces, std::span<const ToolSphere> spheres,
                         const Point<Patient>& tip, ProxyState& state) {
  // a surface is looked for as far as the fields know of one; from there, others may be nearer
  constexpr double kFar_mm = 1000;
  constexpr int kMostSteps = 64, kMostLooks = 4;
  Point<Patient> born = tip;
  for (int look = 0; look < kMostLooks && !is_free(surfaces, spheres, {}, born); ++look) {
    NearSurfaces near(surfaces, spheres, {}, born, kFar_mm);
    if (!leave_surfaces(near, kMostSteps, kFar_mm, born)) return false;
  }
  if (!is_free(surfaces, spheres, {}, born)) return false;
  state = {};
  state.coupled = true;
  state.position = born;
  return true;
}

}  // namespace palpate
