#include "palpate/contact/proxy.h"

#include <algorithm>
#include <bitset>
#include <cmath>
#include <functional>
#include <optional>

#include "contact/capsule_row.h"
#include "contact/footprint.h"
#include "contact/near_surfaces.h"
#include "contact/proxy_spheres.h"
#include "contact/tool_turn.h"
#include "contact/uninitialised_array.h"
#include "palpate/contact/proxy_path.h"

namespace palpate {
namespace {

// upper bound of the distance by which a proxy inside surfaces, e.g. after a tool change, is pushed out
constexpr double kMaxPushOut_mm = kProxyFeel.max_corrections * kProxyFeel.stride_mm();

int layers_of(std::span<const ContactSurface> surfaces) {
  int most = 0;
  for (const ContactSurface& felt : surfaces) most = std::max(most, felt.layer);
  return std::min(most + 1, kMaxLayers);
}

/// Stiffness that a layer contributes for a structure, clamped to the device's limit: the structure's
/// stiffness up to the layer's upper bound, minus the part already provided by the outer layers. That part is
/// the layer's lower bound, or the sum actually given if the surrounding structures are softer than their own
/// layer's upper bound; the difference would otherwise be missing from every layer within.
class LayerStiffness {
 public:
  explicit LayerStiffness(double max_N_per_mm) : max_N_per_mm_(max_N_per_mm) {}

  /// Contribution of a layer's `surface` for `structure`; N/mm.
  double part(const ContactSurface& surface, const ContactSurface& structure) const {
    const double own = std::min(structure.stiffness_N_per_mm, max_N_per_mm_);
    const double up_to = surface.layer >= structure.layer ? own : std::min(own, surface.to_N_per_mm);
    // tolerance for rounding
    const bool less = given_N_per_mm_ && *given_N_per_mm_ < surface.from_N_per_mm * (1 - 1e-9);
    return up_to - std::min(own, less ? *given_N_per_mm_ : surface.from_N_per_mm);
  }
  /// Adds the mean contribution of a layer, from outside to inside.
  void add(double part_N_per_mm) {
    if (given_N_per_mm_) *given_N_per_mm_ += part_N_per_mm;
  }
  /// Reverts to the layers' lower bounds, after a layer without contact or with a deformable structure.
  void forget() { given_N_per_mm_.reset(); }

 private:
  double max_N_per_mm_;
  std::optional<double> given_N_per_mm_ = 0;
};

/// Displacement limit of a proxy in one tick: a ball around the position to which the tip's displacement
/// alone would have carried it. It bounds the change of the spring's stretch to the tip's displacement plus
/// the permitted slip.
struct DisplacementLimit {
  Point<Patient> middle;  ///< Proxy position after the tool's rotation, plus the tip's displacement
  double length_mm = std::numeric_limits<double>::infinity();

  /// Whether a position is outside the ball, so that the limit applies.
  bool holds(const Point<Patient>& at) const { return (at - middle).norm() > length_mm; }
  bool is_at_limit(const Point<Patient>& at) const {
    return (at - middle).norm() > length_mm - kProxyFeel.still_mm;
  }
  // largest fraction of a displacement that stays within the ball
  double fraction_within(const Point<Patient>& from, const Vector<Patient>& way) const {
    if (!holds(from + way)) return 1;
    const Vector<Patient> out = from - middle;
    const double along = out.dot(way), square = way.squared_norm();
    if (!(square > 0)) return 0;
    const double beyond = length_mm * length_mm - out.squared_norm();
    const double root = std::sqrt(std::max(0.0, along * along + square * beyond));
    return std::clamp((root - along) / square, 0.0, 1.0);
  }
};

/// Result of advancing one layer's proxy by one tick.
struct ProxyAdvance {
  bool wedged = false, lagging = false;  ///< As in ProxyResult
  Vector<Patient> stretched_mm;          ///< Spring vector (tip to proxy) of the last tick
  double hand_mm = 0;  ///< Displacement of the tip in this tick plus the arc of the tool's rotation
  /// hand_mm plus the displacement accumulated while the proxy was catching up at zero force.
  double catch_up_mm = 0;
  /// Upper limit of the spring vector's change in this tick: hand_mm plus the permitted slip.
  double max_change_mm = std::numeric_limits<double>::infinity();
};

/// Rate-limited spring stiffness. The stiffness depends on position and contacts and may change only as fast
/// as the proxy may slip: the force change that is not explained by the tip's displacement is at most that of
/// a slip.
/// @param wanted        stiffness of the current contacts, N/mm
/// @param before        stiffness of the last tick, N/mm; empty: unknown, no limit
/// @param stretched_mm  current spring vector, tip to proxy
/// @param slip_N        permitted force change in this tick beyond the tip's displacement
double slow_stiffness(double wanted, std::optional<double> before, const Vector<Patient>& stretched_mm,
                      double slip_N, const ProxyAdvance& walked) {
  const double length_mm = stretched_mm.norm();
  if (!before || !(length_mm > 0)) return wanted;
  // the spring was inactive and may already be long
  const double beyond_mm = length_mm - walked.catch_up_mm;
  if (*before == 0) return beyond_mm > 0 ? std::min(wanted, slip_N / beyond_mm) : wanted;
  if (!std::isfinite(walked.max_change_mm)) return wanted;
  // stiffnesses whose force lies in a ball around the last force
  const double along = walked.stretched_mm.dot(stretched_mm) / (length_mm * length_mm);
  const double across = walked.stretched_mm.squared_norm() / (length_mm * length_mm) - along * along;
  const double change = walked.max_change_mm / length_mm;
  const double most = change * change - across;
  if (!(most > 0)) return *before;
  return std::clamp(wanted, *before * (along - std::sqrt(most)), *before * (along + std::sqrt(most)));
}

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
    for (const RestingContacts::Wall& wall : touched) {
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
    std::array<RestingContacts::Wall, RestingContacts::kMaxConstraints> touched;
    for (std::size_t n = 0; n < walls_.count(); ++n) {
      const std::size_t place = near_.place_of(walls_.near(n));
      touched[n] = {walls_.half_space(n).normal, walls_.half_space(n).offset, walls_.near(n).index,
                    walls_.near(n).sphere, std::nullopt};
      if (friction_known_[place]) touched[n].friction = friction_[place];
    }
    cache_.at_rest.remember(proxy_, state_.punctured, spheres_, std::span(touched).first(walls_.count()));
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
    if (limit_.holds(there)) {
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
    constexpr int kRings = 4, kAround = 8;
    for (double length_mm = std::min(stride_mm(), left_mm_); length_mm > kProxyFeel.stride_mm() / 5;
         length_mm *= 0.5)
      for (int ring = 0; ring < kRings; ++ring)
        for (int n = 0; n < (ring == 0 ? 1 : kAround); ++n) {
          const double aside = ring * 0.47, around = (n + 0.5 * (ring & 1)) * 0.7853981633974483;
          const Vector<Patient> way(length_mm *
                                    (std::cos(aside) * ahead +
                                     std::sin(aside) * (std::cos(around) * right + std::sin(around) * up)));
          const Point<Patient> end = proxy_ + way;
          if (near_.looks() >= max_looks_) return false;
          if (limit_.holds(end) || is_below(end) || (tip_ - end).norm() >= (tip_ - proxy_).norm()) continue;
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
    // projected onto the new direction to the proxy, within the displacement limit of the last stretch
    const double before_mm = stretched_.dot(away) / away_mm;
    const double turned_squared = stretched_.squared_norm() - before_mm * before_mm;
    const double change_mm = std::sqrt(std::max(0.0, limit_.length_mm * limit_.length_mm - turned_squared));
    const double now_mm =
        std::min(std::clamp(wanted_mm, before_mm - change_mm, before_mm + change_mm), away_mm);
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

// Punctured surfaces that are still open: a surface closes when both the operator's and the proxy's tool have
// left it. Both count because the tip may emerge from a deeper layer while the proxy is still inside it.
SurfaceSet still_open(std::span<const ContactSurface> surfaces, std::span<const ToolSphere> spheres,
                      const ToolPose& hand, const ProxyLayer& state) {
  SurfaceSet punctured = state.punctured;
  if (punctured.none()) return punctured;
  const TurnedTool held(spheres, hand.attitude, state.attitude);
  for (std::size_t s = 0; s < surfaces.size(); ++s) {
    if (!punctured[s]) continue;
    const auto has_left = [&](std::span<const ToolSphere> tool, const Point<Patient>& at) {
      return std::all_of(tool.begin(), tool.end(), [&](const ToolSphere& sphere) {
        const ContactPair near{surfaces[s].surface.get(), 0, 0, sphere, row_steps(sphere)};
        int looks = 0;
        return near.clearance(at, kProxyFeel.sealed_mm, near.steps / 2, looks).mm > kProxyFeel.sealed_mm;
      });
    };
    if (has_left(spheres, hand.tip) && has_left(held.spheres(), state.position)) punctured[s] = false;
  }
  return punctured;
}

/// Spring force that acts on each structure that can be punctured, summed over layers.
class PunctureForces {
 public:
  void add(int structure, double force_N) {
    std::size_t n = 0;
    while (n < count_ && structure_[n] != structure) ++n;
    if (n == structure_.size()) return;
    if (n == count_) {
      structure_[count_++] = structure;
      force_N_[n] = 0;
    }
    force_N_[n] += force_N;
  }
  std::size_t count() const { return count_; }
  int structure(std::size_t n) const { return structure_[n]; }
  double force_N(std::size_t n) const { return force_N_[n]; }

 private:
  // capacity; structures beyond it, which do not occur in tissue, are punctured in later ticks
  std::array<int, 16> structure_;
  std::array<double, 16> force_N_;
  std::size_t count_ = 0;
};

/// Structures along the penetration path, from the springs of all layers (docs/decisions/0018). Uses that the
/// sum of the layers' forces equals the sum, over layers, of the cumulated stiffness times the distance from
/// the layer's proxy to the next inner proxy.
class PenetrationPath {
 public:
  /// @param stretched_mm  spring vector of the layer, tip to proxy
  /// @param stiffness     stiffness of the layer, N/mm
  void begin_layer(const Vector<Patient>& stretched_mm, double stiffness) {
    layer_.make(layers_++, stretched_mm, stiffness, owners_);
    force_N_ += stretched_mm * stiffness;
  }
  /// Adds a structure's share of the layer that was begun last.
  /// @param part  0 ... 1
  void add_owner(int structure, double part) {
    const std::span own(owner_.data() + first(), owners_ - first());
    const auto same = std::find_if(own.begin(), own.end(),
                                   [&](const OwnerShare& one) { return one.structure == structure; });
    if (same != own.end())
      same->part += part;
    else if (owners_ < owner_.size())
      owner_.make(owners_++, structure, part);
  }

  /// Writes ProxyResult::felt.
  void tell(ProxyResult& result) const {
    const Vector<Patient> along = force_N_.normalized();
    UninitialisedArray<PathSegment, kMaxOwners> part;
    std::size_t parts = 0;
    double stiffness = 0, all_N = 0;
    for (std::size_t m = 0; m < layers_; ++m) {
      const Layer& layer = layer_[m];
      const bool innermost = m + 1 == layers_;
      const Vector<Patient> beneath_mm = innermost ? Vector<Patient>() : layer_[m + 1].stretched_mm;
      const std::size_t end = innermost ? owners_ : layer_[m + 1].first_owner;
      stiffness += layer.stiffness;
      // an inner layer touched from the side may have a longer spring than the layer around it
      const double depth_mm = std::max(0.0, layer.stretched_mm.norm() - beneath_mm.norm());
      const double force_N = std::max(0.0, stiffness * (layer.stretched_mm - beneath_mm).dot(along));
      all_N += force_N;
      for (std::size_t n = layer.first_owner; n < end; ++n) {
        std::size_t at = 0;
        while (at < parts && part[at].structure != owner_[n].structure) ++at;
        if (at == parts) part.make(parts++).structure = owner_[n].structure;
        part[at].depth_mm += depth_mm * owner_[n].part;
        part[at].share += force_N * owner_[n].part;
      }
    }
    if (!(all_N > 0)) return;
    keep_most({part.data(), parts}, all_N, result);
  }

 private:
  struct Layer {
    Vector<Patient> stretched_mm;
    double stiffness = 0;
    std::size_t first_owner = 0;
  };
  static constexpr std::size_t kMaxOwners = 24;

  static void keep_most(std::span<PathSegment> parts, double all_N, ProxyResult& result) {
    std::array<double, kMaxOwners> shares;
    for (std::size_t n = 0; n < parts.size(); ++n) shares[n] = parts[n].share /= all_N;
    double least = kTouchFeel.min_share;
    if (parts.size() > kMaxPathSegments) {
      std::nth_element(shares.begin(), shares.begin() + kMaxPathSegments - 1,
                       shares.begin() + static_cast<std::ptrdiff_t>(parts.size()), std::greater<>());
      least = std::max(least, shares[kMaxPathSegments - 1]);
    }
    for (const PathSegment& one : parts)
      if (one.share >= least && result.felt_parts < static_cast<int>(kMaxPathSegments))
        result.felt[static_cast<std::size_t>(result.felt_parts++)] = one;
  }
  std::size_t first() const { return layer_[layers_ - 1].first_owner; }

  UninitialisedArray<Layer, kMaxLayers> layer_;
  UninitialisedArray<OwnerShare, kMaxOwners> owner_;
  std::size_t layers_ = 0, owners_ = 0;
  Vector<Patient> force_N_;
};

/// Torque about the tip of a layer's force. The part of the force that the normal forces do not explain is
/// friction, and is distributed over the contacts by their multipliers.
Vector<Patient> torque_of(std::span<const ProxyContact> contacts, std::span<const ToolSphere> spheres,
                          const Vector<Patient>& force_N, double stiffness_N_per_mm) {
  Vector<Patient> torque_Nmm, along_N = force_N;
  double all_mm = 0;
  for (const ProxyContact& contact : contacts) {
    along_N -= contact.normal * (contact.multiplier_mm * stiffness_N_per_mm);
    all_mm += contact.multiplier_mm;
  }
  for (const ProxyContact& contact : contacts) {
    const ToolSphere& sphere = spheres[static_cast<std::size_t>(contact.sphere)];
    torque_Nmm += arm_of(contact, sphere)
                      .cross(contact.normal * (contact.multiplier_mm * stiffness_N_per_mm) +
                             along_N * (contact.multiplier_mm / all_mm));
  }
  return torque_Nmm;
}

/// Sum of the spring forces of all layers.
class LayerSprings {
 public:
  LayerSprings(std::span<const ContactSurface> surfaces, const Point<Patient>& tip,
               const ProxyOptions& options)
      : surfaces_(surfaces),
        tip_(tip),
        options_(options),
        around_(options.max_stiffness_N_per_mm),
        own_around_(std::numeric_limits<double>::infinity()) {}

  /// Adds a layer; layers are added from outside to inside.
  /// @param spheres  tool parts in the proxy's attitude
  /// @param slip_N   as in slow_stiffness()
  /// @param yield    state of the deformable structures, used by the outermost layer only
  /// @return the layer's force
  ProxyForce add(const ProxyLayer& state, OwnerCache& owners, std::span<const ToolSphere> spheres,
                 const ProxyAdvance& walked, double slip_N, ComplianceState& yield,
                 RelaxationState& relaxation) {
    // otherwise the spring does not measure the operator's force, and nothing may be punctured by it
    const bool arrived = !walked.lagging && !walked.wedged;
    const auto contacts = std::span(state.contact).first(static_cast<std::size_t>(state.contacts));
    double all_mm = 0, stiffness = 0, own_stiffness = 0, friction = 0;
    DeformableContact pressed;
    for (std::size_t n = 0; n < contacts.size(); ++n) {
      const ProxyContact& contact = contacts[n];
      const ContactSurface& surface = surfaces_[static_cast<std::size_t>(contact.surface)];
      const ToolSphere& sphere = spheres[static_cast<std::size_t>(contact.sphere)];
      const Vector<Patient> arm_mm = arm_of(contact, sphere);
      owners_.make(n, owners.at(surfaces_, contact.surface, state.position + arm_mm));
      all_mm += contact.multiplier_mm;
      for (const OwnerShare& share : owners_[n].all()) {
        const ContactSurface& felt = surfaces_[static_cast<std::size_t>(share.structure)];
        const double multiplier_mm = contact.multiplier_mm * share.part;
        friction += multiplier_mm * (state.sticking ? felt.static_friction : felt.friction);
        if (felt.yield_modulus_N_per_mm2 > 0) {
          pressed.add(multiplier_mm, felt, arm_mm, sphere.radius_at_mm(contact.part));
          continue;
        }
        own_stiffness += multiplier_mm * own_around_.part(surface, felt);
        stiffness += multiplier_mm * around_.part(surface, felt);
      }
    }
    ProxyForce force;
    if (!(all_mm > 0)) {
      yield = {};
      forget_around();
      return force;
    }
    stiffness /= all_mm;
    own_stiffness /= all_mm;
    if (pressed.multiplier_mm > 0) forget_around();
    around_.add(stiffness);
    own_around_.add(own_stiffness);
    const Vector<Patient> stretched_mm = (state.position - tip_) * state.part;
    // deformable tissue has its own time constants
    if (!(pressed.multiplier_mm > 0))
      stiffness = slow_stiffness(stiffness, state.spring_N_per_mm, stretched_mm, slip_N, walked);
    force.stored_mJ = 0.5 * stiffness * stretched_mm.squared_norm();
    force.tangent_N_per_mm = stiffness;
    if (pressed.multiplier_mm > 0) {
      const Footprint foot = footprint(pressed, contacts, spheres, stretched_mm);
      const Yielded gives = press(pressed, foot, state.position, stretched_mm.norm(), yield, relaxation);
      const double part = pressed.multiplier_mm / all_mm;
      stiffness += part * gives.secant_N_per_mm;
      own_stiffness += part * gives.own_secant_N_per_mm;
      force.tangent_N_per_mm += part * gives.felt.tangent_N_per_mm;
      force.stored_mJ += part * gives.felt.stored_mJ;
      force.force_N = gives.felt.tangential_force_N * part;
      force.yields = true;
    } else {
      yield = {};
    }
    force.stiffness_N_per_mm = stiffness;
    force.force_N += stretched_mm * stiffness;
    way_in_.begin_layer(stretched_mm, stiffness);
    for (std::size_t n = 0; n < contacts.size(); ++n)
      for (const OwnerShare& share : owners_[n].all())
        way_in_.add_owner(share.structure, share.part * contacts[n].multiplier_mm / all_mm);

    force.torque_Nmm = torque_of(contacts, spheres, force.force_N, stiffness);
    for (std::size_t n = 0; n < contacts.size(); ++n) {
      const ProxyContact& contact = contacts[n];
      normals_N_ += contact.normal * (contact.multiplier_mm * stiffness);
      if (!arrived) continue;
      for (const OwnerShare& share : owners_[n].all())
        if (std::isfinite(surfaces_[static_cast<std::size_t>(share.structure)].puncture_N))
          given_.add(share.structure, contact.multiplier_mm * own_stiffness * share.part);
    }
    friction_N_ += friction * stiffness;
    pulls_N_ += all_mm * stiffness;
    return force;
  }

  /// Advances the relaxation state by one tick if add() found no relaxing contact.
  void recover(RelaxationState& relaxation) const {
    if (options_.relaxation_times == nullptr || relaxed_) return;
    advance_relaxation(*options_.relaxation_times, 0, nullptr, options_.dt_s, relaxation);
  }

  Vector<Patient> normal() const { return normals_N_.normalized(); }
  double friction() const { return options_.friction && pulls_N_ > 0 ? friction_N_ / pulls_N_ : 0; }
  const PunctureForces& given() const { return given_; }
  const PenetrationPath& way_in() const { return way_in_; }

 private:
  void forget_around() {
    around_.forget();
    own_around_.forget();
  }
  // contacts with deformable tissue, averaged into one sphere pressing at one point
  struct DeformableContact {
    double multiplier_mm = 0;
    double modulus = 0, radius_mm = 0;  // weighted by the multipliers
    Vector<Patient> arm_mm;             // weighted, from the tip
    RelaxedParts relaxed;               // weighted

    void add(double pull, const ContactSurface& felt, const Vector<Patient>& arm, double radius) {
      multiplier_mm += pull;
      modulus += pull * felt.yield_modulus_N_per_mm2;
      radius_mm += pull * radius;
      arm_mm += arm * pull;
      relaxed.add(felt.relaxed, pull);
    }
  };
  struct Yielded {
    YieldForce felt;
    double secant_N_per_mm = 0, own_secant_N_per_mm = 0;  // own: without the device's stiffness limit
  };
  // Footprint of a tool with several parts, or of a capsule lying along tissue, which may have fewer contacts
  // than places that press. The depths are offset so that the deepest equals the spring's length.
  Footprint footprint(const DeformableContact& pressed, std::span<const ProxyContact> contacts,
                      std::span<const ToolSphere> spheres, const Vector<Patient>& stretched_mm) const {
    const double per_pull = 1 / pressed.multiplier_mm, depth_mm = stretched_mm.norm();
    const Footprint one{depth_mm, pressed.radius_mm * per_pull, 0, 1, pressed.arm_mm * per_pull};
    if ((spheres.size() == 1 && spheres[0].along_mm == Vector<Patient>()) || !(depth_mm > 0)) return one;
    std::array<int, kMaxContacts> edge_contact_front;
    std::size_t count = 0;
    for (const ProxyContact& contact : contacts) {
      const auto known = std::span(edge_contact_front).first(count);
      if (std::ranges::find(known, contact.surface) == known.end())
        edge_contact_front[count++] = contact.surface;
    }
    std::array<PressPlace, kMaxPressPlaces> places;
    std::size_t found =
        press_places(surfaces_, std::span(edge_contact_front).first(count), spheres, tip_, places);
    double deepest_mm = 0;
    for (const PressPlace& place : std::span(places).first(found))
      deepest_mm = std::max(deepest_mm, place.depth_mm);
    const auto shallow = std::remove_if(places.begin(), places.begin() + found, [&](PressPlace& place) {
      place.depth_mm += depth_mm - deepest_mm;
      return !(place.depth_mm > 0);
    });
    found = static_cast<std::size_t>(shallow - places.begin());
    if (found <= 1) return one;
    return footprint_of(std::span(places).first(found), stretched_mm * (1 / depth_mm));
  }
  Yielded press(const DeformableContact& pressed, const Footprint& foot, const Point<Patient>& position,
                double stretched_mm, ComplianceState& yield, RelaxationState& relaxation) {
    const ComplianceFrame* const frame = options_.yields;
    const LocalCompliance spot = frame != nullptr ? frame->spot[options_.device] : LocalCompliance{};
    const double per_pull = 1 / pressed.multiplier_mm, radius_mm = foot.radius_mm, depth_mm = foot.depth_mm;
    const Point<Patient> at = position + foot.arm_mm;
    ContactLaw tissue = blend_compliance(frame != nullptr ? frame->number : 0, spot, at,
                                         pressed.modulus * per_pull, options_.dt_s, yield);
    tissue.surroundings_mm_per_N += foot.interaction_per_mm / tissue.modulus_N_per_mm2;
    Yielded yielded;
    if (!(depth_mm > 0)) return yielded;
    const double most = options_.max_stiffness_N_per_mm / foot.stiffer;
    yielded.felt = yield_force(tissue, depth_mm, radius_mm, most);
    yielded.felt.tangent_N_per_mm *= foot.stiffer;
    yielded.secant_N_per_mm = yielded.felt.force_N / stretched_mm;
    yielded.own_secant_N_per_mm = std::isfinite(most)
                                      ? yield_force(tissue, depth_mm, radius_mm).force_N / stretched_mm
                                      : yielded.secant_N_per_mm;
    if (options_.relaxation_times == nullptr) return yielded;
    RelaxingContact contact{spot.relaxed, at, kYieldFeel.dent_radii * pressed.radius_mm * per_pull,
                            kYieldFeel.blend_s};
    if (!spot.is_known()) {
      contact.parts = {};
      contact.parts.add(pressed.relaxed, per_pull);
    }
    relax(tissue, contact, depth_mm, radius_mm, most, relaxation, yielded);
    return yielded;
  }
  // viscoelastic correction of an elastic force and of its stored energy
  // (docs/decisions/archive/0040-relaxation.md)
  void relax(const ContactLaw& tissue, const RelaxingContact& contact, double depth_mm, double radius_mm,
             double most, RelaxationState& state, Yielded& yielded) {
    const double elastic_N = yielded.felt.force_N;
    const double force_N =
        advance_relaxation(*options_.relaxation_times, elastic_N, &contact, options_.dt_s, state);
    relaxed_ = true;
    double stored_mJ = force_N * depth_mm - complementary_mJ(tissue, state.elastic_N, radius_mm, most);
    TangentialCoefficients aside = yield_aside(tissue, elastic_N);
    for (std::size_t n = 0; n < options_.relaxation_times->count; ++n) {
      const double part = state.parts.of_time[n], lagging_N = state.lagging_N[n];
      if (!(part > 0)) continue;
      stored_mJ += part * complementary_mJ(tissue, lagging_N, radius_mm, most);
      const TangentialCoefficients lagging = yield_aside(tissue, lagging_N);
      aside.of_compliance_N2 -= part * lagging.of_compliance_N2;
      aside.of_stiffening_N3 -= part * lagging.of_stiffening_N3;
    }
    yielded.felt.force_N = force_N;
    yielded.felt.stored_mJ = std::max(0.0, stored_mJ);
    // a contact with a force that rounds to 0 also has a secant stiffness of 0
    const double left = elastic_N > 0 ? force_N / elastic_N : 1;
    yielded.secant_N_per_mm *= left;
    yielded.own_secant_N_per_mm *= left;
    yielded.felt.tangential_force_N = tissue.slope_per_N * std::max(0.0, aside.of_compliance_N2) -
                                      tissue.stiffening_slope * std::max(0.0, aside.of_stiffening_N3);
  }

  std::span<const ContactSurface> surfaces_;
  const Point<Patient> tip_;
  const ProxyOptions options_;
  LayerStiffness around_, own_around_;
  UninitialisedArray<OwnerShares, kMaxContacts> owners_;
  PenetrationPath way_in_;
  Vector<Patient> normals_N_;
  double friction_N_ = 0, pulls_N_ = 0;
  bool relaxed_ = false;
  PunctureForces given_;
};

// whether the puncture of a structure opens a surface
bool opens(const ContactSurface& felt, std::size_t surface, int structure) {
  return static_cast<int>(surface) == structure || felt.structure == structure ||
         std::find(felt.opened_by.begin(), felt.opened_by.end(), structure) != felt.opened_by.end();
}

// Marks a structure as punctured, and with it every surface that it is part of.
void open(std::span<const ContactSurface> surfaces, int structure, ProxyState& state) {
  for (std::size_t s = 0; s < surfaces.size(); ++s) {
    const ContactSurface& felt = surfaces[s];
    if (felt.surface != nullptr && opens(felt, s, structure)) state.layer(felt.layer).punctured[s] = true;
  }
}

// visits every contact, in any layer, whose largest owner is the structure
template <class Visit>
void each_leaning(std::span<const ContactSurface> surfaces, std::span<const ToolSphere> spheres,
                  int structure, const ToolPose& hand, const ProxyState& state, const Visit& visit) {
  for (int n = 0; n < layers_of(surfaces); ++n) {
    const ProxyLayer& layer = state.layer(n);
    const TurnedTool held(spheres, hand.attitude, layer.attitude);
    for (const ProxyContact& contact :
         std::span(layer.contact).first(static_cast<std::size_t>(layer.contacts))) {
      const auto surface = static_cast<std::size_t>(contact.surface);
      if (!opens(surfaces[surface], surface, structure)) continue;
      const ToolSphere& sphere = held.spheres()[static_cast<std::size_t>(contact.sphere)];
      const double radius_mm = sphere.radius_at_mm(contact.part);
      const Point<Patient> middle = layer.position + sphere.offset_mm + sphere.along_mm * contact.part;
      if (owners_at(surfaces, contact.surface, middle - contact.normal * radius_mm).largest() == structure)
        visit(contact, middle, radius_mm);
    }
  }
}

// Permanent holes: extends those that the tool is in, and lets the tool into those that it fits.
void use_holes(std::span<const ContactSurface> surfaces, std::span<const ToolSphere> spheres,
               const ToolPose& hand, ProxyState& state, Holes& holes) {
  std::array<int, Holes::kMost> seen;
  std::size_t count = 0;
  for (const Hole& hole : holes.all()) {
    const auto known = std::span(seen).first(count);
    if (std::find(known.begin(), known.end(), hole.structure) == known.end()) seen[count++] = hole.structure;
  }
  for (const int structure : std::span(seen).first(count)) {
    const auto s = static_cast<std::size_t>(structure);
    if (state.layer(surfaces[s].layer).punctured[s]) {
      const TurnedTool held(spheres, hand.attitude, state.attitude);
      for (const ToolSphere& sphere : held.spheres())
        for (const double part : {0.0, 1.0})
          holes.lead(structure, state.position + sphere.offset_mm + sphere.along_mm * part);
      continue;
    }
    bool leans = false, fits = true;
    each_leaning(surfaces, spheres, structure, hand, state,
                 [&](const ProxyContact& /*contact*/, const Point<Patient>& middle, double radius_mm) {
                   leans = true;
                   fits = fits && std::any_of(holes.all().begin(), holes.all().end(), [&](const Hole& hole) {
                            return hole.structure == structure && hole.fits(middle, radius_mm);
                          });
                 });
    if (leans && fits) open(surfaces, structure, state);
  }
}

// creates permanent holes where a structure with stays_open was punctured
void leave_holes(std::span<const ContactSurface> surfaces, std::span<const ToolSphere> spheres, int structure,
                 const ToolPose& hand, const ProxyState& state, Holes& holes) {
  std::bitset<kMaxToolSpheres> done;
  each_leaning(surfaces, spheres, structure, hand, state,
               [&](const ProxyContact& contact, const Point<Patient>& middle, double radius_mm) {
                 // a part in contact in several layers leaves one hole, in the outermost
                 if (done[static_cast<std::size_t>(contact.sphere)]) return;
                 done[static_cast<std::size_t>(contact.sphere)] = true;
                 holes.make({structure, middle, -contact.normal, 0, radius_mm});
               });
}

// whether a contact of the last tick was punctured; its proxy is released without a rate limit
bool is_contact_punctured(const ProxyLayer& state) {
  const auto contacts = std::span(state.contact).first(static_cast<std::size_t>(state.contacts));
  return std::any_of(contacts.begin(), contacts.end(), [&](const ProxyContact& contact) {
    return state.punctured[static_cast<std::size_t>(contact.surface)];
  });
}

// arc length of a rotation at the tool point farthest from the tip
double arc_of_turn_mm(std::span<const ToolSphere> spheres, const Eigen::Quaterniond& from,
                      const Eigen::Quaterniond& to) {
  if (from.coeffs() == to.coeffs()) return 0;
  double farthest_mm = 0;
  for (const ToolSphere& sphere : spheres)
    farthest_mm =
        std::max({farthest_mm, sphere.offset_mm.norm(), (sphere.offset_mm + sphere.along_mm).norm()});
  return farthest_mm * from.angularDistance(to);
}

/// Displacement limit of a layer's proxy.
/// @param state         after the tool's rotation, which has already pushed the proxy
/// @param tip_moved     displacement of the tip in this tick, mm
/// @param turned_mm     arc length of that rotation
/// @param max_slip_mm  permitted slip
DisplacementLimit leash_of(const ProxyLayer& state, const Vector<Patient>& tip_moved, double turned_mm,
                           double max_slip_mm) {
  if (state.contacts == 0 || is_contact_punctured(state)) return {};
  return {state.position + tip_moved, tip_moved.norm() + turned_mm + max_slip_mm};
}

// force change of a layer that is not slip: explained by the tool's displacement, or exempt from the limit
double explained_N(std::optional<double> before_N_per_mm, const ProxyForce& now, const ProxyAdvance& walked) {
  constexpr double kAll = std::numeric_limits<double>::infinity();
  if (!before_N_per_mm) return kAll;
  if (*before_N_per_mm == 0) return now.yields ? kAll : now.tangent_N_per_mm * walked.catch_up_mm;
  if (!std::isfinite(walked.max_change_mm)) return kAll;
  return std::max(*before_N_per_mm, now.tangent_N_per_mm) * walked.hand_mm;
}

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
  result.stretched_mm = (state.position - (tip - tip_moved)) * state.part;
  const ToolTurn turn = turn_tool(surfaces, spheres, layer, hand.attitude, state, way);
  const ProxySpheres held(spheres, hand.attitude, state.attitude);

  // from free space the proxy covers any distance of the tip; in contact the path per tick is limited
  const double to_tip_mm = (tip - state.position).norm() + kProxyFeel.slack_mm;
  const double max_mm = state.contacts == 0 ? to_tip_mm : std::min(to_tip_mm, kProxyFeel.max_way_mm);
  const double turned_mm = arc_of_turn_mm(spheres, attitude_before, state.attitude);
  const DisplacementLimit leash = leash_of(state, tip_moved, turned_mm, max_slip_mm);
  result.hand_mm = tip_moved.norm() + turned_mm;
  result.catch_up_mm = state.catch_up_mm + result.hand_mm;
  result.max_change_mm = leash.length_mm;
  const bool in_walls = !ProxyUpdate(surfaces, held.spheres(), layer, max_mm, leash, result.stretched_mm, tip,
                                     state, cache, options, way, room)
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

// whether the layer's proxy coincides with the operator's pose without contact
bool follows(const ProxyLayer& layer, const ToolPose& hand) {
  return layer.contacts == 0 && layer.attitude.coeffs() == hand.attitude.coeffs() &&
         (hand.tip - layer.position).norm() <= kProxyFeel.arrived_mm;
}

// Whether the tool is clear of the outermost layer and has a collision-free straight path to another pose
// (linear tip motion, spherical interpolation of the attitude). Sphere tracing (Hart 1996); false if that
// exceeds the work limit of a tick.
bool is_clear_way(std::span<const ContactSurface> surfaces, std::span<const ToolSphere> spheres,
                  const SurfaceSet& punctured, const ToolPose& hand, const ToolPose& to) {
  const Vector<Patient> way = to.tip - hand.tip;
  const double arc_mm = arc_of_turn_mm(spheres, hand.attitude, to.attitude);
  const double way_mm = way.norm() + arc_mm, reach_mm = std::max(way_mm, kProxyFeel.back_clearance_mm);
  PairSet near(surfaces, spheres, 0, punctured, hand.tip, reach_mm);
  if (near.reach_mm() < reach_mm) return false;
  const auto clearance_mm = [&](const Point<Patient>& at) {
    double min_mm = std::numeric_limits<double>::infinity();
    for (std::size_t n = 0; n < near.count(); ++n) min_mm = std::min(min_mm, near.clearance(n, at));
    return min_mm;
  };
  double leaves_mm = clearance_mm(hand.tip);
  if (leaves_mm < kProxyFeel.back_clearance_mm) return false;
  double gone_mm = 0;
  for (int place = 0; place < kProxyFeel.max_back_places; ++place) {
    if (!(leaves_mm + kProxyFeel.dip_mm > 0)) return false;
    gone_mm += (leaves_mm + kProxyFeel.dip_mm) / near.steepest();
    if (gone_mm >= way_mm) return true;
    const double part = gone_mm / way_mm;
    if (arc_mm > 0)
      near.turn(TurnedTool(spheres, hand.attitude, hand.attitude.slerp(part, to.attitude)).spheres());
    leaves_mm = clearance_mm(hand.tip + way * part);
  }
  return false;
}

// Whether the tool is back in free space on the side from which contact began. The remaining contacts then
// hold it from elsewhere, e.g. a pocket into which the proxy was pressed.
bool has_withdrawn(std::span<const ContactSurface> surfaces, std::span<const ToolSphere> spheres,
                   const ToolPose& hand, ProxyState& state) {
  if (state.contacts == 0 || (hand.tip - state.last_search_tip).norm() < kProxyFeel.back_pitch_mm)
    return false;
  state.last_search_tip = hand.tip;
  // early-out: the tip usually lies below the surface in contact
  const ProxyContact& edge_contact_front = state.contact[0];
  const ToolSphere& sphere = spheres[static_cast<std::size_t>(edge_contact_front.sphere)];
  const Surface& surface = *surfaces[static_cast<std::size_t>(edge_contact_front.surface)].surface;
  const double enough_mm = sphere.radius_mm + kProxyFeel.back_clearance_mm;
  if (nearest_part(surface, sphere, hand.tip, enough_mm).distance_mm < enough_mm) return false;
  return is_clear_way(surfaces, spheres, state.punctured, hand, {state.free_tip, state.free_attitude});
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

// transfer_proxy() for one layer
void transfer_layer(std::span<const ContactSurface> surfaces, std::span<const ToolSphere> spheres, int layer,
                    std::span<const SurfaceCorrespondence> before, ProxyLayer& state,
                    ProxyLayerCache& cache) {
  const ProxyLayer old = state;
  cache.at_rest.forget();
  SurfaceSet same, punctured;
  for (std::size_t s = 0; s < before.size(); ++s) {
    same[s] = before[s].same;
    punctured[s] = before[s].index >= 0 && old.punctured[static_cast<std::size_t>(before[s].index)] &&
                   surfaces[s].surface != nullptr && surfaces[s].layer == layer;
  }
  if (!old.coupled || !is_free(surfaces, spheres, layer, punctured, same, old.position)) {
    state = {};
    state.position = old.position;
    return;
  }

  // remaps contacts to the new indices; contacts with surfaces that no longer exist are dropped
  state.punctured = punctured;
  state.spring_N_per_mm.reset();
  state.contacts = 0;
  for (const ProxyContact& contact : std::span(old.contact).first(static_cast<std::size_t>(old.contacts))) {
    const auto now = std::find_if(before.begin(), before.end(), [&](const SurfaceCorrespondence& one) {
      return one.index == contact.surface;
    });
    if (now == before.end()) continue;
    ProxyContact& kept = state.contact[static_cast<std::size_t>(state.contacts++)];
    kept = contact;
    kept.surface = static_cast<int>(now - before.begin());
  }
  state.sticking = old.sticking && state.contacts > 0;
}

// initialises a layer's proxy for a tip that is inside tissue
// @param punctured  surfaces that the tool has punctured
bool initialise_layer(std::span<const ContactSurface> surfaces, std::span<const ToolSphere> spheres,
                      int layer, const ToolPose& hand, const SurfaceSet& punctured, ProxyLayer& state,
                      ProxyLayerCache& cache) {
  // the first search reaches as far as the distance fields; other surfaces may be nearer at its result
  constexpr double kFar_mm = 1000;
  constexpr int kMaxSteps = 64, kMaxGatherings = 4;
  Point<Patient> born = hand.tip;
  const auto is_out = [&] { return is_free(surfaces, spheres, layer, punctured, {}, born); };
  for (int look = 0; look < kMaxGatherings && !is_out(); ++look) {
    PairSet near(surfaces, spheres, layer, punctured, born, kFar_mm);
    if (!project_out(near, kMaxSteps, kFar_mm, born)) return false;
  }
  if (!is_out()) return false;
  cache.at_rest.forget();
  state = {};
  state.coupled = true;
  state.punctured = punctured;
  state.position = born;
  state.attitude = hand.attitude;
  return true;
}

}  // namespace

OwnerShares owners_at(std::span<const ContactSurface> surfaces, int index, const Point<Patient>& at) {
  const ContactSurface& felt = surfaces[static_cast<std::size_t>(index)];
  if (felt.owners == nullptr) return OwnerShares(felt.structure < 0 ? index : felt.structure);
  if (felt.made == nullptr) return felt.owners->at(at);
  // labels below the surface differ only from a depth of half a voxel
  const double beneath_mm = 0.5 * felt.original_labels->geometry().min_spacing_mm();
  return felt.made->distance_mm(at) < -beneath_mm ? felt.owners->within(*felt.original_labels, at)
                                                  : felt.owners->at(at);
}

OwnerShares OwnerCache::at(std::span<const ContactSurface> surfaces, int index, const Point<Patient>& place) {
  const ContactSurface& felt = surfaces[static_cast<std::size_t>(index)];
  if (felt.owners == nullptr) return owners_at(surfaces, index, place);
  const bool cut = felt.made != nullptr;
  for (const Known& known : known_)
    if (known.owners == felt.owners->number() && known.surface == index && known.cut == cut &&
        known.place == place)
      return known.shares;
  Known& known = known_[next_];
  next_ = (next_ + 1) % known_.size();
  known = {felt.owners->number(), index, cut, place, owners_at(surfaces, index, place)};
  return known.shares;
}

std::span<const RestingContacts::Wall> RestingContacts::find(const Point<Patient>& position,
                                                             const SurfaceSet& punctured,
                                                             std::span<const ToolSphere> spheres) const {
  bool same = walls_ > 0 && position == position_ && spheres.size() == spheres_ && punctured == punctured_;
  for (std::size_t k = 0; same && k < spheres.size(); ++k)
    same = spheres[k].offset_mm == sphere_[k].offset_mm && spheres[k].radius_mm == sphere_[k].radius_mm &&
           spheres[k].along_mm == Vector<Patient>();
  return {wall_.data(), same ? walls_ : 0};
}

void RestingContacts::remember(const Point<Patient>& position, const SurfaceSet& punctured,
                               std::span<const ToolSphere> spheres, std::span<const Wall> walls) {
  PALPATE_CHECK(walls.size() <= kMaxConstraints && spheres.size() <= kMaxToolSpheres);
  std::copy(walls.begin(), walls.end(), wall_.begin());
  walls_ = walls.size();
  spheres_ = spheres.size();
  for (std::size_t k = 0; k < spheres_; ++k) sphere_[k] = {spheres[k].offset_mm, spheres[k].radius_mm};
  position_ = position;
  punctured_ = punctured;
}

TurnedTool::TurnedTool(std::span<const ToolSphere> spheres, const Eigen::Quaterniond& from,
                       const Eigen::Quaterniond& to)
    : count_(spheres.size()) {
  PALPATE_CHECK(count_ <= kMaxToolSpheres);
  std::copy(spheres.begin(), spheres.end(), spheres_.begin());
  if (from.coeffs() == to.coeffs()) return;
  const Eigen::Matrix3d turn = (to * from.conjugate()).toRotationMatrix();
  for (std::size_t k = 0; k < count_; ++k) {
    spheres_[k].offset_mm = Vector<Patient>(turn * spheres[k].offset_mm.eigen());
    spheres_[k].along_mm = Vector<Patient>(turn * spheres[k].along_mm.eigen());
  }
}

double ProxyRelease::fade(double max_N) {
  const double before_N = force_N.norm();
  limit(std::max(0.0, before_N - max_N));
  return std::min(before_N, max_N);
}

void ProxyRelease::limit(double max_N) {
  const double before_N = force_N.norm();
  if (!(before_N > max_N)) return;
  // exactly zero at the end
  if (!(max_N > 0)) {
    *this = {};
    return;
  }
  const double part = max_N / before_N;
  force_N = force_N * part;
  torque_Nmm = torque_Nmm * part;
  // quadratic in the force, as for a spring of constant stiffness
  stored_mJ *= part * part;
}

ProxyResult advance_proxy(std::span<const ContactSurface> surfaces, std::span<const ToolSphere> spheres,
                          const ToolPose& hand, ProxyState& state, const ProxyOptions& options,
                          ProxyPath* way) {
  PALPATE_CHECK(surfaces.size() <= kMaxSurfaces && !spheres.empty() && spheres.size() <= kMaxToolSpheres);
  ProxyResult result;
  LayerSprings springs(surfaces, hand.tip, options);
  UpdateWorkspace room;
  // force change that slip may still cause in this layer and those within, and the stiffness that it acts on
  double slip_N = options.max_slip_N_per_s * options.dt_s, growth_N_per_mm = state.stiffness_N_per_mm;
  slip_N -= state.release.fade(slip_N);
  const Point<Patient> tip_before = state.tip;
  const Vector<Patient> tip_moved = hand.tip - state.tip;
  state.tip = hand.tip;
  state.stiffness_N_per_mm = 0;
  bool covered = !has_withdrawn(surfaces, spheres, hand, state);
  if (!covered) state.yield = {};
  for (int n = 0; n < layers_of(surfaces); ++n) {
    ProxyLayer& layer = state.layer(n);
    covered = covered && (n == 0 || !state.layer(n - 1).coupled || !follows(state.layer(n - 1), hand));
    if (!covered) {
      release_layer(surfaces, spheres, hand, tip_before, layer, state.release);
      // the proxy was reset: a single vertex, no path
      if (n == 0 && way != nullptr) way->add(layer.position, layer.attitude);
      continue;
    }
    const std::optional<double> before_N_per_mm = layer.spring_N_per_mm;
    const double max_slip_mm =
        growth_N_per_mm > 0 ? slip_N / growth_N_per_mm : std::numeric_limits<double>::infinity();
    const ProxyAdvance walked = advance_layer(surfaces, spheres, n, hand, tip_moved, max_slip_mm, layer,
                                              state.cache(n), options, n == 0 ? way : nullptr, room);
    result.wedged = result.wedged || walked.wedged;
    result.lagging = result.lagging || walked.lagging;
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
    const ProxyForce force = springs.add(layer, state.cache(n).owners, held.spheres(), walked, slip_N,
                                         n == 0 ? state.yield : none, state.relaxation);
    layer.spring_N_per_mm = force.stiffness_N_per_mm;
    layer.catch_up_mm = layer.contacts == 0 && walked.lagging ? walked.catch_up_mm : 0;
    // slip that this layer has not used is left to the layers within
    const double changed_N = (force.force_N - walked.stretched_mm * before_N_per_mm.value_or(0)).norm();
    slip_N -= std::clamp(changed_N - explained_N(before_N_per_mm, force, walked), 0.0, slip_N);
    growth_N_per_mm = 0;
    for (int within = n + 1; within < kMaxLayers; ++within)
      growth_N_per_mm += state.layer(within).spring_N_per_mm.value_or(0);
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
  springs.way_in().tell(result);
  if (options.holes != nullptr && !options.holes->empty())
    use_holes(surfaces, spheres, hand, state, *options.holes);
  for (std::size_t n = 0; n < springs.given().count(); ++n) {
    const int structure = springs.given().structure(n);
    if (!(springs.given().force_N(n) > surfaces[static_cast<std::size_t>(structure)].puncture_N)) continue;
    if (options.holes != nullptr && surfaces[static_cast<std::size_t>(structure)].stays_open)
      leave_holes(surfaces, spheres, structure, hand, state, *options.holes);
    open(surfaces, structure, state);
    result.ruptured = true;
  }
  return result;
}

ProxyResult advance_proxy(std::span<const ContactSurface> surfaces, std::span<const ToolSphere> spheres,
                          const ToolPose& hand, ProxyState& state, const ProxyOptions& options) {
  return advance_proxy(surfaces, spheres, hand, state, options, nullptr);
}

void transfer_proxy(std::span<const ContactSurface> surfaces, std::span<const ToolSphere> spheres,
                    const ToolPose& hand, std::span<const SurfaceCorrespondence> before, ProxyState& state) {
  PALPATE_CHECK(surfaces.size() <= kMaxSurfaces && (before.empty() || before.size() == surfaces.size()));
  for (int n = 0; n < kMaxLayers; ++n) {
    ProxyLayer& layer = state.layer(n);
    transfer_layer(surfaces, TurnedTool(spheres, hand.attitude, layer.attitude).spheres(), n, before, layer,
                   state.cache(n));
  }
}

bool initialise_proxy(std::span<const ContactSurface> surfaces, std::span<const ToolSphere> spheres,
                      const ToolPose& hand, ProxyState& state) {
  ProxyState born;
  for (int n = 0; n < layers_of(surfaces); ++n)
    if (!initialise_layer(surfaces, spheres, n, hand, {}, born.layer(n), born.cache(n)) && n == 0)
      return false;
  born.free_tip = born.position;
  born.free_attitude = born.attitude;
  state = born;
  return true;
}

void transfer_proxy_to_new_layers(std::span<const ContactSurface> surfaces,
                                  std::span<const ToolSphere> spheres, const ToolPose& hand,
                                  std::span<const SurfaceCorrespondence> before, ProxyState& state) {
  PALPATE_CHECK(surfaces.size() <= kMaxSurfaces && (before.empty() || before.size() == surfaces.size()));
  SurfaceSet through;
  for (std::size_t s = 0; s < before.size(); ++s)
    for (int n = 0; n < kMaxLayers && before[s].index >= 0; ++n)
      through[s] = through[s] || state.layer(n).punctured[static_cast<std::size_t>(before[s].index)];
  const bool was_coupled = state.coupled;
  transfer_layer(surfaces, TurnedTool(spheres, hand.attitude, state.attitude).spheres(), 0, before, state,
                 state.cache(0));
  state.reset_inner_layers();
  state.yield = {};
  state.relaxation = {};
  // the side from which the tip entered was unknown
  if (!was_coupled) return;
  state.punctured = {};
  for (std::size_t s = 0; s < surfaces.size(); ++s)
    if (through[s]) open(surfaces, static_cast<int>(s), state);
  for (int n = state.coupled ? 1 : 0; n < layers_of(surfaces); ++n) {
    const SurfaceSet punctured = state.layer(n).punctured;
    const bool born = initialise_layer(surfaces, spheres, n, hand, punctured, state.layer(n), state.cache(n));
    if (!born || n > 0) continue;
    state.free_tip = state.position;
    state.free_attitude = state.attitude;
  }
}

}  // namespace palpate
