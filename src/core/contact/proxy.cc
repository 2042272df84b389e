#include "palpate/contact/proxy.h"

#include <algorithm>
#include <bitset>
#include <cmath>
#include <numbers>
#include <optional>

#include "contact/capsule_row.h"
#include "contact/contact_springs.h"
#include "contact/force_continuity.h"
#include "contact/near_surfaces.h"
#include "contact/proxy_spheres.h"
#include "contact/puncture.h"
#include "contact/tool_turn.h"
#include "contact/uninitialised_array.h"
#include "contact/withdrawal.h"
#include "palpate/contact/proxy_path.h"

namespace palpate {
namespace {

// upper bound of the distance by which a proxy inside surfaces, e.g. after a tool change, is pushed out
constexpr double kMaxPushOut_mm = kProxyFeel.max_corrections * kProxyFeel.stride_mm();

/// Result of advancing one layer's proxy by one tick.
struct ProxyAdvance {
  bool wedged = false, lagging = false;  ///< As in ProxyResult
  SpringMotion spring;
};

/// Working memory shared by the proxy updates of a tick; constructing it takes longer than many updates.
struct UpdateWorkspace {
  /// Origin of a contact: index of its sphere-surface pair, and the sphere in the capsule's row.
  struct TouchedAt {
    std::size_t near = 0;
    int step = 0;
  };

  PairSet near;
  ContactConstraints walls;
  std::bitset<kMaxNear> friction_known;
  UninitialisedArray<Friction, kMaxNear> friction;
  UninitialisedArray<TouchedAt, kMaxContacts> touched_at;
};

/// Update of one layer's proxy position in one tick: substeps towards the tip along the surfaces.
class ProxyUpdate {
 public:
  /// @param spheres    tool parts in the proxy's attitude
  /// @param max_mm    maximum path length
  /// @param leash      displacement limit
  /// @param stretched  spring vector of the last tick, tip to proxy, mm
  /// @param way        receives every vertex of the path; may be null
  ProxyUpdate(std::span<const ContactSurface> surfaces, std::span<const ToolSphere> spheres, int layer,
              double max_mm, const DisplacementLimit& leash, const Vector<Patient>& stretched,
              const Point<Patient>& tip, ProxyLayer& state, ProxyLayerCache& cache,
              const ProxyOptions& options, ProxyPath* way, UpdateWorkspace& room)
      : surfaces_(surfaces),
        limit_(leash),
        leash_mm_(leash.length_mm),
        first_contact_before_(state.contact[0]),
        stretched_(stretched),
        options_(options),
        has_capsules_(has_capsules(spheres)),
        away_(has_capsules_ ? std::min(options.away, kProxyFeel.away_of_capsules) : options.away),
        spheres_(spheres),
        layer_(layer),
        near_(room.near),
        to_go_mm_(max_mm),
        tip_(tip),
        state_(state),
        cache_(cache),
        proxy_(state.position),
        anchor_(state.position),
        last_way_(state.last_displacement),
        anchored_(state.contacts > 0),
        walls_(room.walls),
        friction_known_(room.friction_known),
        friction_(room.friction),
        touched_at_(room.touched_at),
        way_(way) {
    walls_.clear();
  }

  /// Runs the update. Returns false if the proxy starts inside surfaces (e.g. after a tool change) and cannot
  /// be pushed out.
  bool go(ProxyAdvance& result) {
    bool moves = false, through_free_space = false;
    if (!rests_as_before()) {
      gather_near();
      if (near_.penetrates() && !leave()) {
        result.wedged = true;
        state_.contacts = 0;
        return false;
      }
      note(proxy_);
      moves = !moves_freely() && advance_substeps(result);
      // a blocked proxy gets a contact before it has arrived, too: a tick at zero force would be felt
      through_free_space = slips() && is_held_by_nothing();
      if (!result.wedged && !through_free_space && is_held_by_nothing()) contact_nearest();
    } else {
      note(proxy_);
    }
    centre_capsule_contacts();
    limit_spring_rate(through_free_space);
    result.lagging = moves || slips();
    state_.position = proxy_;
    state_.last_displacement = last_way_;
    return true;
  }

 private:
  // Moves straight to the tip if the proxy is in free space with no surface nearby: the common case for most
  // layers.
  bool moves_freely() {
    const Vector<Patient> way = tip_ - proxy_;
    const double way_mm = way.norm();
    if (near_.count() > 0 || state_.contacts > 0 || way_mm + kProxyFeel.still_mm >= left_mm_) return false;
    anchored_ = state_.sticking = false;
    state_.part = 1;
    if (way_mm <= kProxyFeel.still_mm) return true;
    proxy_ = tip_;
    last_way_ = way;
    note(proxy_);
    return true;
  }

  // moves in substeps; true if the work limit was reached before the goal
  bool advance_substeps(ProxyAdvance& result) {
    max_looks_ = near_.looks() + (has_capsules_ ? kProxyFeel.max_looks_of_capsules : kProxyFeel.max_looks);
    int stride = 0;
    bool moves = true;
    state_.part = 1;
    for (int felt = 0;; ++felt) {
      while (moves && stride < kProxyFeel.max_strides && near_.looks() < max_looks_ &&
             left_mm_ > kProxyFeel.still_mm) {
        moves = step(result);
        stride += moves;
        if (moves && left_mm_ <= kProxyFeel.still_mm) gather_near();
      }
      if (moves || result.wedged || slips() || !is_held_by_nothing()) break;
      moves = felt < kProxyFeel.max_feelings && search_direction();
      if (!moves) break;
      if (left_mm_ <= kProxyFeel.still_mm) gather_near();
    }
    return moves;
  }

  // Checks the cached contacts of a proxy at rest. If the proxy still does not move (the common case), no
  // surface is queried; otherwise the state is left unchanged.
  bool rests_as_before() {
    const auto touched = cache_.at_rest.find(proxy_, state_.punctured, spheres_);
    if (touched.empty()) return false;
    near_.clear();
    friction_known_.reset();
    for (const RestingContacts::Constraint& wall : touched) {
      const ContactSurface& felt = surfaces_[static_cast<std::size_t>(wall.surface)];
      const ToolSphere& sphere = spheres_[static_cast<std::size_t>(wall.sphere)];
      const std::size_t place = near_.count();
      walls_.recall(near_.recall({felt.surface.get(), wall.surface, wall.sphere, sphere, 0}),
                    {wall.normal, wall.offset_mm});
      if (!wall.friction) continue;
      friction_known_[place] = true;
      friction_.make(place, *wall.friction);
    }
    const bool sticking = state_.sticking, anchored = anchored_;
    set_anchor();
    if (const auto nearest = closest_point(tip_, walls_.half_spaces()); nearest && nearest->count > 0) {
      const Point<Patient> goal = with_friction(*nearest);
      if ((goal - proxy_).norm() <= kProxyFeel.still_mm) {
        remember(*nearest);
        state_.part = 1;
        return true;
      }
    }
    state_.sticking = sticking;
    anchored_ = anchored;
    limit_.length_mm = leash_mm_;
    walls_.clear();
    return false;
  }

  // caches the active contacts for the next tick, provided that all pairs were gathered at this position
  void remember_rest() {
    const bool stayed = proxy_ == state_.position && near_.count() < kMaxNear && !has_capsules_;
    if (!stayed || walls_.count() == 0 || walls_.count() > RestingContacts::kMaxConstraints) return;
    std::array<RestingContacts::Constraint, RestingContacts::kMaxConstraints> touched;
    for (std::size_t n = 0; n < walls_.count(); ++n) {
      const std::size_t place = near_.place_of(walls_.near(n));
      touched[n] = {walls_.half_space(n).normal, walls_.half_space(n).offset, walls_.near(n).index,
                    walls_.near(n).sphere, std::nullopt};
      if (friction_known_[place]) touched[n].friction = friction_[place];
    }
    cache_.at_rest.store(proxy_, state_.punctured, spheres_, std::span(touched).first(walls_.count()));
  }

  // Gathers the surfaces within reach of the next part of the path. In free space that is the whole path; in
  // contact the proxy usually covers only a small part of the distance to the tip, and a shorter reach has
  // fewer pairs.
  void gather_near() {
    const double part_mm = state_.contacts == 0 ? to_go_mm_ : std::min(to_go_mm_, kProxyFeel.part_mm);
    near_.gather(surfaces_, spheres_, layer_, state_.punctured, proxy_, part_mm + kProxyFeel.stride_mm());
    friction_known_.reset();
    steepest_ = near_.steepest();
    left_mm_ = std::min(part_mm, near_.reach_mm());
    to_go_mm_ -= part_mm;
  }

  // pushes the proxy out of surfaces that it starts in
  bool leave() {
    near_.gather(surfaces_, spheres_, layer_, state_.punctured, proxy_, kMaxPushOut_mm);
    steepest_ = near_.steepest();
    if (!project_out(near_, kProxyFeel.max_corrections, stride_mm(), proxy_)) return false;
    to_go_mm_ += left_mm_;
    gather_near();
    return true;
  }

  // whether the displacement limit stopped the proxy on its way to another position
  bool slips() const { return leashed_ && limit_.is_at_limit(proxy_); }

  // one substep; false when the proxy has come to rest
  bool step(ProxyAdvance& result) {
    const double free_mm = build_constraints();
    leashed_ = false;
    // a failed attempt must not release friction: each attempt starts with the friction state before the
    // first
    const bool sticking = state_.sticking, anchored = anchored_;
    for (int attempt = 0; attempt < kProxyFeel.max_tries; ++attempt) {
      state_.sticking = sticking;
      anchored_ = anchored;
      const auto nearest = closest_point(tip_, walls_.half_spaces());
      if (!nearest) {
        result.wedged = true;
        return false;
      }
      const Point<Patient> goal = with_friction(*nearest);
      remember(*nearest);
      if ((goal - proxy_).norm() <= kProxyFeel.still_mm) {
        if (attempt == 0) remember_rest();
        return false;
      }
      const Point<Patient> end = towards(goal, walls_.count() == 0 ? free_mm : stride_mm());
      // a surface first hit by this substep becomes a constraint, and the goal is solved again
      if (add_walls_below(end)) continue;
      return move_to(end);
    }
    state_.sticking = sticking;
    anchored_ = anchored;
    return retry_shorter();
  }

  double stride_mm() const { return kProxyFeel.stride_mm() / steepest_; }

  // End of the next substep: the goal, or the point at the maximum substep length towards it. Half of that
  // where the direction reversed, which occurs on concave surfaces whose radius of curvature is less than the
  // depth.
  Point<Patient> towards(const Point<Patient>& goal, double max_mm) {
    const Vector<Patient> way = goal - proxy_;
    const double length_mm = way.norm();
    double part = std::min(1.0, std::min(max_mm, left_mm_) / length_mm);
    if (walls_.count() > 0 && way.dot(last_way_) < 0) part *= 0.5;
    const double fraction_within = limit_.fraction_within(proxy_, way);
    leashed_ = fraction_within < part;
    part = std::min(part, fraction_within);
    return part < 1 ? proxy_ + way * part : goal;
  }

  // Moves to the end of a substep and projects it back outside the surfaces. A substep that increases the
  // distance to the tip is rejected, so that the proxy comes to rest where constraints turn within one
  // substep.
  bool move_to(const Point<Patient>& asked) {
    Point<Patient> end = asked, there = end;
    if (!project_out(near_, kProxyFeel.max_corrections, stride_mm(), there)) return false;
    // the projection may have moved the point beyond the displacement limit
    if (limit_.is_outside(there)) {
      end = proxy_ + (end - proxy_) * limit_.fraction_within(proxy_, there - proxy_);
      there = end;
      if (!project_out(near_, kProxyFeel.max_corrections, stride_mm(), there)) return false;
      leashed_ = true;
    }
    // after a projection in several steps the end points no longer bound the penetration in between
    if ((there - end).norm() > stride_mm()) return false;
    const Vector<Patient> way = there - proxy_;
    if ((tip_ - there).norm() > (tip_ - proxy_).norm() + away_ * way.norm()) return false;
    left_mm_ -= std::max((end - proxy_).norm(), way.norm());
    proxy_ = there;
    last_way_ = way;
    note(end);
    note(there);
    return way.norm() > kProxyFeel.still_mm;
  }

  // records a vertex of the path
  void note(const Point<Patient>& corner) {
    if (way_ != nullptr) way_->add(corner, state_.attitude);
  }

  // constraints turn faster than a substep can follow: retries with shorter ones
  bool retry_shorter() {
    const auto nearest = closest_point(tip_, walls_.half_spaces());
    if (!nearest) return false;
    Vector<Patient> stride = towards(with_friction(*nearest), stride_mm()) - proxy_;
    for (int halving = 0; halving < kProxyFeel.max_halvings; ++halving) {
      stride = stride * 0.5;
      const Point<Patient> end = proxy_ + stride;
      if (!is_below(end)) return move_to(end);
    }
    return false;
  }

  // Whether the proxy has stopped away from the tip without a contact. Where a gap closes, or thin tissue
  // lies in a gap, normals may point towards the tip through the surface.
  bool is_held_by_nothing() const {
    return state_.contacts == 0 && (tip_ - proxy_).norm() > kProxyFeel.arrived_mm;
  }

  // Searches for a substep that decreases the distance to the tip and stays outside: straight ahead, then on
  // cones of increasing angle. Returns false if there is none.
  bool search_direction() {
    const Eigen::Vector3d ahead = (tip_ - proxy_).normalized().eigen();
    const Eigen::Vector3d right = ahead.unitOrthogonal(), up = ahead.cross(right);
    constexpr double kBetween_rad = 2 * std::numbers::pi / kProxyFeel.search_directions;
    for (double length_mm = std::min(stride_mm(), left_mm_);
         length_mm > kProxyFeel.stride_mm() / kProxyFeel.search_shortest_divisor; length_mm *= 0.5)
      for (int cone = 0; cone < kProxyFeel.search_cones; ++cone)
        for (int n = 0; n < (cone == 0 ? 1 : kProxyFeel.search_directions); ++n) {
          const double aside = cone * kProxyFeel.search_cone_rad,
                       around = (n + 0.5 * (cone & 1)) * kBetween_rad;
          const Vector<Patient> way(length_mm *
                                    (std::cos(aside) * ahead +
                                     std::sin(aside) * (std::cos(around) * right + std::sin(around) * up)));
          const Point<Patient> end = proxy_ + way;
          if (near_.looks() >= max_looks_) return false;
          if (limit_.is_outside(end) || is_below(end) || (tip_ - end).norm() >= (tip_ - proxy_).norm())
            continue;
          if (move_to(end)) return true;
        }
    return false;
  }

  // Adds a contact with the blocking surface; otherwise there would be no force at any depth of the tip. The
  // multiplier is the depth of the tip, not its distance to the proxy, so that a tip that has emerged
  // elsewhere is not pulled back.
  void contact_nearest() {
    std::size_t nearest = 0;
    double min_mm = std::numeric_limits<double>::infinity(), deepest_mm = 0;
    for (std::size_t n = 0; n < near_.count(); ++n) {
      deepest_mm = std::max(deepest_mm, -near_.clearance(n, tip_));
      const double clearance_mm = near_.clearance(n, proxy_);
      if (clearance_mm < min_mm) nearest = n;
      min_mm = std::min(min_mm, clearance_mm);
    }
    if (min_mm > kProxyFeel.skin_mm || deepest_mm <= 0) return;
    const Vector<Patient> away = proxy_ - tip_;
    const double multiplier_mm = std::min(away.norm(), deepest_mm);
    state_.contacts = 0;
    add_contact(nearest, near_.step(nearest), away.normalized(), multiplier_mm);
    state_.part = multiplier_mm / away.norm();
  }

  // Rate limit of the spring's stretch: changes from the last value to the target by at most the displacement
  // limit, also if the target is zero or less than the distance to the proxy.
  void limit_spring_rate(bool through_free_space) {
    const Vector<Patient> away = proxy_ - tip_;
    const double away_mm = away.norm();
    if (!std::isfinite(limit_.length_mm) || away_mm <= kProxyFeel.arrived_mm) return;
    const double wanted_mm = through_free_space || state_.contacts > 0 ? state_.part * away_mm : 0;
    const double now_mm = limit_stretch_mm(away, wanted_mm, stretched_, limit_.length_mm);
    if (now_mm <= 0) {
      state_.contacts = 0;
      return;
    }
    state_.part = now_mm / away_mm;
    for (int n = 0; n < state_.contacts; ++n)
      state_.contact[static_cast<std::size_t>(n)].multiplier_mm *= now_mm / wanted_mm;
    if (state_.contacts > 0) return;
    state_.contacts = 1;
    state_.contact[0] = first_contact_before_;
    state_.contact[0].normal = away.normalized();
    state_.contact[0].multiplier_mm = now_mm;
  }

  // Places the contact of a capsule that lies along a surface at the middle of the touching interval, which
  // does not jump between voxels as the nearest point does.
  void centre_capsule_contacts() {
    // contacts carried over from the last tick have it already
    if (!leant_) return;
    for (int n = 0; n < state_.contacts; ++n) {
      const UpdateWorkspace::TouchedAt& at = touched_at_[static_cast<std::size_t>(n)];
      state_.contact[static_cast<std::size_t>(n)].part = near_.middle_of_touching(at.near, proxy_, at.step);
    }
  }

  // builds half-spaces of all touched surfaces; returns the free distance if there are none
  double build_constraints() {
    walls_.clear();
    double free_mm = std::numeric_limits<double>::infinity();
    for (std::size_t n = 0; n < near_.count(); ++n) {
      const double clearance_mm = near_.clearance(n, proxy_, kProxyFeel.skin_mm);
      if (clearance_mm <= kProxyFeel.skin_mm) walls_.add(near_[n], near_.step(n), proxy_, clearance_mm);
    }
    if (walls_.count() == 0) free_mm = free_way_mm();
    if (walls_.count() > 0) set_anchor();
    return free_mm;
  }

  // sets the friction anchor when contact begins
  void set_anchor() {
    if (anchored_) return;
    anchor_ = proxy_;
    anchored_ = true;
    state_.sticking = false;
  }

  // distance within which there is no surface
  double free_way_mm() {
    double free_mm = std::numeric_limits<double>::infinity();
    for (std::size_t n = 0; n < near_.count(); ++n) {
      // for a touched surface without a normal, half of the remaining clearance
      const double clearance_mm = near_.clearance(n, proxy_);
      const double leaves_mm = std::max({0.0, clearance_mm - 0.5 * kProxyFeel.skin_mm, 0.5 * clearance_mm});
      free_mm = std::min(free_mm, leaves_mm / near_[n].surface->steepest());
    }
    return free_mm;
  }

  // whether a position penetrates any surface by more than the tolerance
  bool is_below(const Point<Patient>& end) {
    for (std::size_t n = 0; n < near_.count(); ++n)
      if (near_.clearance(n, end, -kProxyFeel.dip_mm) < -kProxyFeel.dip_mm) return true;
    return false;
  }

  // adds the tangent plane of every surface that the end of a substep penetrates; true if there is any
  bool add_walls_below(const Point<Patient>& end) {
    bool below = false;
    for (std::size_t n = 0; n < near_.count(); ++n) {
      const double clearance_mm = near_.clearance(n, end, -kProxyFeel.dip_mm);
      if (clearance_mm >= -kProxyFeel.dip_mm) continue;
      walls_.add(near_[n], near_.step(n), end, clearance_mm);
      below = true;
    }
    return below;
  }

  // Applies the friction cone: the proxy is displaced from the frictionless goal towards the friction anchor,
  // by at most the cone's radius at this depth.
  Point<Patient> with_friction(const ClosestPoint& nearest) {
    if (nearest.count == 0) anchored_ = false;
    if (nearest.count == 0 || !options_.friction) {
      state_.sticking = false;
      return nearest.point;
    }
    double still = 0, sliding = 0, all_mm = 0;
    for (int n = 0; n < nearest.count; ++n) {
      const double multiplier_mm = nearest.multiplier_mm[static_cast<std::size_t>(n)];
      const Friction& friction =
          friction_of(static_cast<std::size_t>(nearest.active[static_cast<std::size_t>(n)]));
      still += multiplier_mm * friction.still;
      sliding += multiplier_mm * friction.sliding;
      all_mm += multiplier_mm;
    }
    // with one constraint the multiplier is the depth; in a corner the depth is less than the sum of
    // multipliers
    const double depth_mm = (nearest.point - tip_).norm();
    const Vector<Patient> behind = along_walls(anchor_ - nearest.point, nearest);
    const double behind_mm = behind.norm();
    const bool stuck = state_.sticking;
    state_.sticking = behind_mm <= (stuck ? still : sliding) / all_mm * depth_mm;
    // the distance released when static friction changes to kinetic is exempt from the displacement limit
    if (stuck && !state_.sticking) limit_.length_mm = leash_mm_ + (still - sliding) / all_mm * depth_mm;
    if (state_.sticking) return nearest.point + behind;
    return nearest.point + behind * (sliding / all_mm * depth_mm / behind_mm);
  }

  // component in the tangent space of the active constraints
  Vector<Patient> along_walls(const Vector<Patient>& way, const ClosestPoint& nearest) const {
    if (nearest.count == 3) return {};
    const Vector<Patient>& first = walls_.half_space(static_cast<std::size_t>(nearest.active[0])).normal;
    if (nearest.count == 1) return way - first * first.dot(way);
    const Vector<Patient>& second = walls_.half_space(static_cast<std::size_t>(nearest.active[1])).normal;
    const Vector<Patient> edge = first.cross(second).normalized();
    return edge * edge.dot(way);
  }

  // stores the contacts; parallel constraints share the multiplier, e.g. two spheres on one plane
  void remember(const ClosestPoint& nearest) {
    state_.contacts = 0;
    for (int n = 0; n < nearest.count; ++n) {
      const HalfSpace& held = walls_.half_space(static_cast<std::size_t>(nearest.active[n]));
      std::array<double, kMaxHalfSpaces> weight{};
      double all = 0;
      for (std::size_t w = 0; w < walls_.count(); ++w) {
        const HalfSpace& wall = walls_.half_space(w);
        const double clearance_mm = wall.clearance(nearest.point);
        if (wall.normal.dot(held.normal) < kProxyFeel.parallel || clearance_mm >= kProxyFeel.beside_mm)
          continue;
        all += weight[w] = 1 - std::max(0.0, clearance_mm) / kProxyFeel.beside_mm;
      }
      for (std::size_t w = 0; w < walls_.count(); ++w)
        if (weight[w] > 0)
          add_contact(near_.place_of(walls_.near(w)), walls_.step(w), walls_.half_space(w).normal,
                      nearest.multiplier_mm[static_cast<std::size_t>(n)] * weight[w] / all);
    }
  }

  void add_contact(std::size_t near, int step, const Vector<Patient>& normal, double multiplier_mm) {
    if (state_.contacts == static_cast<int>(kMaxContacts)) return;
    leant_ = true;
    const auto n = static_cast<std::size_t>(state_.contacts++);
    state_.contact[n] = {near_[near].index, near_[near].sphere, near_[near].part(step), normal,
                         multiplier_mm};
    touched_at_.make(n, near, step);
  }

  // friction of a pair; on a common surface, evaluated where the constraint is first met in this tick
  const Friction& friction_of(std::size_t wall) {
    const ContactPair& near = walls_.near(wall);
    const std::size_t place = near_.place_of(near);
    if (!friction_known_[place]) {
      friction_known_[place] = true;
      Friction& known = friction_.make(place);
      const Point<Patient> at = proxy_ + (near.offset_mm(walls_.step(wall)) -
                                          walls_.half_space(wall).normal * near.radius_mm(walls_.step(wall)));
      const OwnerShares owners = cache_.owners.at(surfaces_, near.index, at);
      for (const OwnerShare& share : owners.all()) {
        const ContactSurface& felt = surfaces_[static_cast<std::size_t>(share.structure)];
        known.still += share.part * felt.static_friction;
        known.sliding += share.part * felt.friction;
      }
    }
    return friction_[place];
  }

  std::span<const ContactSurface> surfaces_;
  DisplacementLimit limit_;
  const double leash_mm_;                    // displacement limit before friction released any
  bool leashed_ = false;                     // the last substep was shortened by the displacement limit
  bool leant_ = false;                       // the contacts were set by this update
  const ProxyContact first_contact_before_;  // first contact of the last tick
  const Vector<Patient> stretched_;          // spring vector of the last tick, mm
  const ProxyOptions options_;
  const bool has_capsules_;
  const double away_;  // maximum fraction of a substep by which the distance to the tip may increase
  std::span<const ToolSphere> spheres_;
  const int layer_;
  PairSet& near_;
  int max_looks_ = 0;
  double to_go_mm_;      // path length beyond the current part
  double left_mm_ = 0;   // path length left in the current part
  double steepest_ = 1;  // maximum slope of the gathered distance fields
  const Point<Patient> tip_;
  ProxyLayer& state_;
  ProxyLayerCache& cache_;
  Point<Patient> proxy_;
  Point<Patient> anchor_;  // position at which friction holds the proxy
  Vector<Patient> last_way_;
  bool anchored_;
  ContactConstraints& walls_;
  std::bitset<kMaxNear>& friction_known_;
  UninitialisedArray<Friction, kMaxNear>& friction_;
  UninitialisedArray<UpdateWorkspace::TouchedAt, kMaxContacts>& touched_at_;
  ProxyPath* way_;
};

// rotates and moves one layer's proxy
ProxyAdvance advance_layer(std::span<const ContactSurface> surfaces, std::span<const ToolSphere> spheres,
                           int layer, const ToolPose& hand, const Vector<Patient>& tip_moved,
                           double max_slip_mm, ProxyLayer& state, ProxyLayerCache& cache,
                           const ProxyOptions& options, ProxyPath* way, UpdateWorkspace& room) {
  const Point<Patient>& tip = hand.tip;
  ProxyAdvance result;
  if (!state.coupled) {
    if (!is_free(surfaces, spheres, layer, {}, {}, tip)) return result;
    state = {};
    cache.at_rest.forget();
    state.coupled = true;
    state.position = tip;
    state.attitude = hand.attitude;
  }
  state.punctured = still_open(surfaces, spheres, hand, state);

  const Eigen::Quaterniond attitude_before = state.attitude;
  result.spring.stretched_mm = (state.position - (tip - tip_moved)) * state.part;
  const ToolTurn turn = turn_tool(surfaces, spheres, layer, hand.attitude, state, way);
  const ProxySpheres held(spheres, hand.attitude, state.attitude);

  // from free space the proxy covers any distance of the tip; in contact the path per tick is limited
  const double to_tip_mm = (tip - state.position).norm() + kProxyFeel.slack_mm;
  const double max_mm = state.contacts == 0 ? to_tip_mm : std::min(to_tip_mm, kProxyFeel.max_way_mm);
  const double turned_mm = arc_of_rotation_mm(spheres, attitude_before, state.attitude);
  const DisplacementLimit leash = limit_displacement(state, tip_moved, turned_mm, max_slip_mm);
  result.spring.tool_mm = tip_moved.norm() + turned_mm;
  result.spring.catch_up_mm = state.catch_up_mm + result.spring.tool_mm;
  result.spring.max_change_mm = leash.length_mm;
  const bool in_walls = !ProxyUpdate(surfaces, held.spheres(), layer, max_mm, leash,
                                     result.spring.stretched_mm, tip, state, cache, options, way, room)
                             .go(result);
  // a proxy inside surfaces, or stuck without a constraint, is reset to the tip where the tip is free
  const bool far = !result.lagging && !turn.lagging && (tip - state.position).norm() > kProxyFeel.lost_mm;
  const bool lost =
      state.contacts == 0 && (in_walls || far) && is_free(surfaces, spheres, layer, state.punctured, {}, tip);
  state.lost_s = lost ? state.lost_s + options.dt_s : 0;
  if (lost && (in_walls || state.lost_s > kProxyFeel.lost_s)) {
    state.position = tip;
    state.attitude = hand.attitude;
  }
  result.lagging = result.lagging || turn.lagging;
  result.wedged = result.wedged || turn.blocked;
  return result;
}

// Resets a layer whose covering layer has released the tool: the proxy takes the operator's pose without
// collision checks. The force of its spring in the last tick becomes a residual force, minus the part
// explained by the tip's displacement since: a tool lifted off within one tick leaves none.
void release_layer(std::span<const ContactSurface> surfaces, std::span<const ToolSphere> spheres,
                   const ToolPose& hand, const Point<Patient>& tip_before, ProxyLayer& layer,
                   ProxyRelease& release) {
  const Vector<Patient> stretched_mm = (layer.position - tip_before) * layer.part;
  const double left_mm = stretched_mm.norm() - (hand.tip - tip_before).norm();
  if (const double stiffness = layer.spring_N_per_mm.value_or(0); stiffness > 0 && left_mm > 0) {
    const Vector<Patient> left_N = stretched_mm * (stiffness * left_mm / stretched_mm.norm());
    const auto contacts = std::span(layer.contact).first(static_cast<std::size_t>(layer.contacts));
    release.force_N += left_N;
    release.torque_Nmm += torque_of(contacts, ProxySpheres(spheres, hand.attitude, layer.attitude).spheres(),
                                    left_N, stiffness);
    release.stored_mJ += 0.5 * stiffness * left_mm * left_mm;
  }
  const Vector<Patient> way = hand.tip - layer.position;
  layer.attitude = hand.attitude;
  if (!layer.coupled || way.norm() > kProxyFeel.still_mm) {
    layer.position = hand.tip;
    layer.last_displacement = way;
  }
  layer.coupled = true;
  layer.sticking = false;
  layer.contacts = 0;
  layer.part = 1;
  layer.spring_N_per_mm = 0;
  layer.catch_up_mm = layer.lost_s = 0;
  layer.punctured = still_open(surfaces, spheres, hand, layer);
}

}  // namespace

ProxyResult advance_proxy(std::span<const ContactSurface> surfaces, std::span<const ToolSphere> spheres,
                          const ToolPose& hand, ProxyState& state, const ProxyOptions& options,
                          ProxyPath* way) {
  PALPATE_CHECK(surfaces.size() <= kMaxSurfaces && !spheres.empty() && spheres.size() <= kMaxToolSpheres);
  ProxyResult result;
  ContactSprings springs(surfaces, hand.tip, options);
  UpdateWorkspace room;
  SlipBudget slip{options.max_slip_N_per_s * options.dt_s, state.stiffness_N_per_mm};
  slip.left_N -= state.release.fade(slip.left_N);
  const Point<Patient> tip_before = state.tip;
  const Vector<Patient> tip_moved = hand.tip - state.tip;
  state.tip = hand.tip;
  state.stiffness_N_per_mm = 0;
  bool covered = !has_withdrawn(surfaces, spheres, hand, state);
  if (!covered) state.yield = {};
  for (int n = 0; n < layer_count(surfaces); ++n) {
    ProxyLayer& layer = state.layer(n);
    covered = covered && (n == 0 || !state.layer(n - 1).coupled || !follows(state.layer(n - 1), hand));
    if (!covered) {
      release_layer(surfaces, spheres, hand, tip_before, layer, state.release);
      // the proxy was reset: a single vertex, no path
      if (n == 0 && way != nullptr) way->add(layer.position, layer.attitude);
      continue;
    }
    const std::optional<double> before_N_per_mm = layer.spring_N_per_mm;
    const ProxyAdvance advance = advance_layer(surfaces, spheres, n, hand, tip_moved, slip.max_slip_mm(),
                                               layer, state.cache(n), options, n == 0 ? way : nullptr, room);
    result.wedged = result.wedged || advance.wedged;
    result.lagging = result.lagging || advance.lagging;
    if (!state.coupled) {
      // the side from which the tip entered is unknown
      state.reset_inner_layers();
      state.release = {};
      springs.recover(state.relaxation);
      return result;
    }
    const ProxySpheres held(spheres, hand.attitude, layer.attitude);
    // only the outermost layer contains deformable structures
    ComplianceState none;
    const bool has_arrived = !advance.lagging && !advance.wedged;
    const ProxyForce force =
        springs.add({layer, held.spheres(), advance.spring, has_arrived, slip.left_N}, state.cache(n).owners,
                    n == 0 ? state.yield : none, state.relaxation);
    layer.spring_N_per_mm = force.stiffness_N_per_mm;
    layer.catch_up_mm = layer.contacts == 0 && advance.lagging ? advance.spring.catch_up_mm : 0;
    // slip that this layer has not used is left to the layers within
    slip.spend(before_N_per_mm, force, advance.spring);
    slip.stiffness_N_per_mm = 0;
    for (int within = n + 1; within < kMaxLayers; ++within)
      slip.stiffness_N_per_mm += state.layer(within).spring_N_per_mm.value_or(0);
    result.of_layer[static_cast<std::size_t>(n)] = force;
    result.force_N += force.force_N;
    result.torque_Nmm += force.torque_Nmm;
    result.stiffness_N_per_mm += force.stiffness_N_per_mm;
    result.tangent_N_per_mm += force.tangent_N_per_mm;
    result.stored_mJ += force.stored_mJ;
    result.yields = result.yields || force.yields;
  }
  if (follows(state, hand)) {
    state.free_tip = hand.tip;
    state.free_attitude = hand.attitude;
  }
  springs.recover(state.relaxation);
  state.release.limit(options.most_force_N);
  state.stiffness_N_per_mm = result.tangent_N_per_mm;
  result.release = state.release;
  result.force_N += state.release.force_N;
  result.torque_Nmm += state.release.torque_Nmm;
  result.stored_mJ += state.release.stored_mJ;
  result.normal = springs.normal();
  result.friction = springs.friction();
  springs.path().report(result);
  result.ruptured = puncture(surfaces, spheres, hand, springs.puncture_forces(), options.holes, state);
  return result;
}

ProxyResult advance_proxy(std::span<const ContactSurface> surfaces, std::span<const ToolSphere> spheres,
                          const ToolPose& hand, ProxyState& state, const ProxyOptions& options) {
  return advance_proxy(surfaces, spheres, hand, state, options, nullptr);
}

}  // namespace palpate
