#include "palpate/tissue/removal.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "palpate/base/check.h"
#include "palpate/tissue/bone_density.h"
#include "palpate/tissue/thin_voxels.h"
#include "palpate/tissue/tissue_settings.h"

namespace palpate {
namespace {

// Minimum depth in material of a sample that counts as cut: half of lookahead_mm. Beside a pocket, where the
// burr's surface leaves the material, the samples ahead of the surface are less deep and do not count.
constexpr double kMinSampleDepth_mm = kCuttingSettings.lookahead_mm / 2;

/// Pose of the burr's head as constrained by one layer.
struct HeadPose {
  Point<Patient> at;
  Eigen::Quaterniond attitude;
};

/// A burr at the hand's attitude, and at those of the layers' proxies.
class BurrTool {
 public:
  BurrTool(const Burr& burr, const ToolPose& tool_pose)
      : burr_(burr), hand_(tool_pose), head_(burr.head(0)) {}

  const Burr& operator*() const { return burr_; }
  const Burr* operator->() const { return &burr_; }
  bool is_ball() const { return !(burr_.length_mm > 0); }
  ToolSphere head(const Eigen::Quaterniond& attitude) const {
    return RotatedTool({&head_, 1}, hand_.attitude, attitude).spheres()[0];
  }
  /// Unit vector of its spindle.
  Vector<Patient> spindle(const ToolSphere& head) const {
    return is_ball() ? burr_.axis : head.axis_mm / burr_.length_mm;
  }
  /// Pose interpolated between two poses. A ball always has the final attitude.
  HeadPose interpolate(const HeadPose& from, const HeadPose& to, double fraction) const {
    const bool turns = !is_ball() && fraction < 1 && from.attitude.coeffs() != to.attitude.coeffs();
    return {from.at + (to.at - from.at) * fraction,
            turns ? from.attitude.slerp(fraction, to.attitude) : to.attitude};
  }

 private:
  const Burr& burr_;
  const ToolPose& hand_;
  ToolSphere head_;
};

// whether a surface's bounds prove that no centre of the head's balls is within `within_mm`
bool is_certainly_beyond(const Surface& surface, const ToolSphere& head, const Point<Patient>& at,
                         double within_mm) {
  if (head.axis_mm == Vector<Patient>()) return surface.is_farther_than(at, within_mm);
  const Eigen::Array3d begin = at.eigen().array(), end = (at + head.axis_mm).eigen().array();
  return surface.is_farther_than(begin.min(end), begin.max(end), within_mm);
}

// whether no ball of the head, treated as if all had the first one's radius, is closer than `mm`
bool is_farther(const Surface& surface, const ToolSphere& head, const Point<Patient>& at, double mm) {
  const double wider_mm = std::max(0.0, head.radius_change_mm);
  const double beside_mm = 0.5 * head.axis_mm.norm() * surface.max_gradient();
  return surface.lower_bound_mm(at + head.axis_mm * 0.5) >= mm + wider_mm + beside_mm;
}

/// Displacements of both ends of a head's axis.
struct HeadDisplacement {
  double length_mm = 0;                  // displacement of the end that moves farther
  std::array<Vector<Patient>, 2> along;  // unit vectors
  std::array<double, 2> fraction{};      // fraction of length_mm

  HeadDisplacement(const Vector<Patient>& first, const Vector<Patient>& last) {
    const std::array paths{first, last};
    const std::array lengths{first.norm(), last.norm()};
    length_mm = std::max(lengths[0], lengths[1]);
    for (std::size_t end = 0; end < 2; ++end) {
      if (!(lengths[end] > 0)) continue;
      along[end] = paths[end] / lengths[end];
      fraction[end] = lengths[end] / length_mm;
    }
  }
};

/// Material directly in front of a burr, projected along its displacement.
struct CuttingFront {
  double area_mm2 = 0;
  double edge_mm_per_s = 0;      // mean over the area
  double energy_mJ_per_mm3 = 0;  // mean over the area
  double thin_fraction = 0;      // fraction of the energy that is of thin bone
};

/// Samples the material around a burr's head.
class MaterialSampler {
 public:
  /// @param head  at the layer's attitude
  /// @param at    position of the head in that layer
  MaterialSampler(std::span<const ContactSurface> surfaces, const BurrTool& burr, const ToolSphere& head,
                  const ProxyLayer& layer, int number, const Point<Patient>& at, const BurrState& state)
      : surfaces_(surfaces),
        burr_(*burr),
        spindle_(burr.spindle(head)),
        head_(head),
        at_(at),
        turn_rad_(static_cast<double>(state.thin_ticks % kTurns) * kGoldenAngle) {
    const double near_mm = burr_.max_radius_mm() + kCuttingSettings.lookahead_mm;
    for (std::size_t s = 0; s < surfaces.size() && near_count_ < near_surfaces_.size(); ++s) {
      const ContactSurface& surface = surfaces[s];
      const bool covered =
          surface.covered_by >= 0 && !layer.punctured[static_cast<std::size_t>(surface.covered_by)];
      if (surface.layer != number || surface.surface == nullptr || layer.punctured[s] || covered) continue;
      if (is_certainly_beyond(*surface.surface, head, at_, near_mm) && surface.surface->outside_mm() > 0)
        continue;
      if (is_farther(*surface.surface, head, at_, burr_.radius_mm + kCuttingSettings.lookahead_mm)) continue;
      near_surfaces_[near_count_++] = static_cast<int>(s);
    }
    if (near_count_ == 0) return;
    if (burr_.model != nullptr) ratios_ = burr_.model->density_ratios.get();
    // thin voxels are those of the innermost layer
    if (burr_.model != nullptr && burr_.model->thin_voxels != nullptr &&
        std::ranges::none_of(surfaces, [&](const ContactSurface& one) { return one.layer > number; }))
      voxels_ = burr_.model;
    // most recent sweeps first: the burr is most likely inside these
    const std::span<const Sweep> pending = state.pending();
    for (auto sweep = pending.rbegin(); sweep != pending.rend(); ++sweep)
      swept_[swept_count_++].emplace(*sweep);
  }

  CuttingFront along(const HeadDisplacement& displacement) const {
    if (near_count_ == 0) return {};
    Sum sum;
    for_directions(displacement, kCuttingSettings.directions, kCuttingSettings.lateral_samples, 0,
                   [&](const Point<Patient>& centre, const Vector<Patient>& direction, double radius_mm,
                       double share_mm2) {
                     add(material_at(centre + direction * (radius_mm + kCuttingSettings.lookahead_mm),
                                     kMinSampleDepth_mm),
                         direction, radius_mm, share_mm2, sum);
                   });
    if (voxels_ == nullptr) return front_of(sum);
    // directions differ in every tick: along a thin wall, fixed directions would sample the same part of it
    // throughout the cut
    for_directions(displacement, kCuttingSettings.thin_directions, kCuttingSettings.thin_directions,
                   turn_rad_,
                   [&](const Point<Patient>& centre, const Vector<Patient>& direction, double radius_mm,
                       double share_mm2) {
                     add(thin_before(centre + direction * (radius_mm + kCuttingSettings.thin_lookahead_mm)),
                         direction, radius_mm, share_mm2, sum);
                   });
    return front_of(sum);
  }

  /// Estimate for a burr resting on an edge, such as the rim of a groove, where no sampling point is deep
  /// enough to count: each contact contributes as much as one sampling direction.
  CuttingFront edge_contact_front(const ProxyLayer& layer) const {
    if (near_count_ == 0) return {};
    Sum sum;
    for (int n = 0; n < layer.contact_count; ++n) {
      const ProxyContact& contact = layer.contacts[static_cast<std::size_t>(n)];
      const Point<Patient> centre = at_ + head_.axis_mm * contact.axis_fraction;
      // the contact normal is smoothed and may point past the edge
      const ContactSurface& surface = surfaces_[static_cast<std::size_t>(contact.surface)];
      const Vector<Patient> outward =
          sample_central_differences(surface.surface->position(), centre).gradient.normalized();
      // between voxels the distance to the edge may be underestimated
      const double radius_mm = head_.radius_at_mm(contact.axis_fraction);
      const Point<Patient> start = centre - outward * surface.clearance_error_mm;
      add(material_at(start + -outward * (radius_mm + kCuttingSettings.lookahead_mm), 0), -outward, radius_mm,
          std::numbers::pi * radius_mm * radius_mm / kCuttingSettings.directions, sum);
    }
    return front_of(sum);
  }

  /// edge_contact_front() for thin bone: a burr in contact with thin bone that no sampling direction hits.
  /// @param displacement  only its part into the contact counts
  CuttingFront thin_contact_front(const ProxyLayer& layer, const HeadDisplacement& displacement) const {
    if (near_count_ == 0 || voxels_ == nullptr) return {};
    Sum sum;
    for (int n = 0; n < layer.contact_count; ++n) {
      const ProxyContact& contact = layer.contacts[static_cast<std::size_t>(n)];
      const Point<Patient> centre = at_ + head_.axis_mm * contact.axis_fraction;
      const ContactSurface& surface = surfaces_[static_cast<std::size_t>(contact.surface)];
      const Vector<Patient> inward =
          -sample_central_differences(surface.surface->position(), centre).gradient.normalized();
      const double radius_mm = head_.radius_at_mm(contact.axis_fraction);
      const double share_mm2 = std::numbers::pi * radius_mm * radius_mm / kCuttingSettings.directions;
      const double into = std::max(inward.dot(displacement.along[0]), inward.dot(displacement.along[1]));
      if (!(into > 0)) continue;
      Material material = owned(contact.surface, centre + inward * radius_mm);
      material.bone = kThin;
      add(material, inward, radius_mm, share_mm2 * into, sum);
    }
    return front_of(sum);
  }

 private:
  // sums over sampling points: area, and area-weighted edge speed and energy
  struct Sum {
    double area_mm2 = 0, speed = 0, energy = 0, thin_energy = 0;
  };
  struct Material {
    double fraction = 0;  // fraction that counts, 0 ... 1
    double energy = 0;    // mJ/mm3
    BoneClass bone = kThick;
  };

  CuttingFront front_of(const Sum& sum) const {
    if (!(sum.area_mm2 > 0)) return {};
    const double peripheral_speed_mm_per_s = 2 * std::numbers::pi * burr_.revolutions_per_s * burr_.radius_mm;
    return {sum.area_mm2, peripheral_speed_mm_per_s * sum.speed / sum.area_mm2, sum.energy / sum.area_mm2,
            sum.thin_energy > 0 ? sum.thin_energy / sum.energy : 0};
  }

  // Calls run(centre, direction, radius_mm, share_mm2) for directions ahead, where share_mm2 is the area of
  // the head that each represents, projected along the displacement.
  // @param turn_rad  of the directions about the displacement, and about the axis
  template <class Run>
  void for_directions(const HeadDisplacement& displacement, int end_samples, int lateral_samples,
                      double turn_rad, const Run& run) const {
    const bool is_ball = head_.axis_mm == Vector<Patient>();
    for (std::size_t end = 0; end < (is_ball ? 1 : 2); ++end)
      if (displacement.fraction[end] > 0) for_end_cap(end, displacement, end_samples, turn_rad, run);
    if (!is_ball) for_lateral_surface(displacement, lateral_samples, turn_rad, run);
  }

  // the hemisphere of one end, except where the rest of the head covers it
  template <class Run>
  void for_end_cap(std::size_t end, const HeadDisplacement& displacement, int directions, double turn_rad,
                   const Run& run) const {
    const double along_row = end == 0 ? 0 : 1, radius_mm = head_.radius_at_mm(along_row);
    const Vector<Patient>& ahead = displacement.along[end];
    const Vector<Patient> side = perpendicular(ahead), up = ahead.cross(side);
    const double share_mm2 =
        std::numbers::pi * radius_mm * radius_mm / directions * displacement.fraction[end];
    for (int n = 0; n < directions; ++n) {
      // Vogel's spiral: points evenly spread over a disc
      const double r = std::sqrt((n + 0.5) / directions), turn = n * kGoldenAngle + turn_rad;
      const Vector<Patient> direction =
          ahead * std::sqrt(1 - r * r) + side * (r * std::cos(turn)) + up * (r * std::sin(turn));
      // only the end that extends farther in this direction
      if ((head_.axis_mm.dot(direction) + head_.radius_change_mm > 0) != (end == 1)) continue;
      run(at_ + head_.axis_mm * along_row, direction, radius_mm, share_mm2);
    }
  }

  // the lateral surface, which is straight along the axis
  template <class Run>
  void for_lateral_surface(const HeadDisplacement& displacement, int samples, double turn_rad,
                           const Run& run) const {
    const double length_mm = head_.axis_mm.norm(), slope = head_.radius_change_mm / length_mm;
    if (!(std::abs(slope) < 1)) return;
    const double cosine = std::sqrt(1 - slope * slope);
    const Vector<Patient> axis = head_.axis_mm / length_mm, side = perpendicular(axis), up = axis.cross(side);
    const std::array paths{displacement.along[0] * displacement.fraction[0],
                           displacement.along[1] * displacement.fraction[1]};
    for (int n = 0; n < samples; ++n) {
      // spiral with even spacing along and around the axis
      const double fraction = (n + 0.5) / samples, turn = n * kGoldenAngle + turn_rad;
      const Vector<Patient> direction =
          axis * -slope + (side * std::cos(turn) + up * std::sin(turn)) * cosine;
      const double ahead = direction.dot(paths[0] * (1 - fraction) + paths[1] * fraction);
      if (!(ahead > 0)) continue;
      const double radius_mm = head_.radius_at_mm(fraction);
      const double share_mm2 = 2 * std::numbers::pi * radius_mm * cosine * cosine * length_mm / samples;
      run(at_ + head_.axis_mm * fraction, direction, radius_mm, share_mm2 * ahead);
    }
  }

  void add(const Material& material, const Vector<Patient>& direction, double radius_mm, double share_mm2,
           Sum& sum) const {
    if (!(material.fraction > 0)) return;
    const double area_mm2 = share_mm2 * material.fraction;
    sum.area_mm2 += area_mm2;
    sum.speed += area_mm2 * spindle_.cross(direction).norm() * (radius_mm / burr_.radius_mm);
    sum.energy += area_mm2 * material.energy;
    if (material.bone == kThin) sum.thin_energy += area_mm2 * material.energy;
  }

  // material at a point by the surfaces
  // @param counts_mm  depth in material at which a point begins to count
  Material material_at(const Point<Patient>& position, double counts_mm) const {
    if (voxels_ != nullptr && thinness(voxel_at(position)) != kNoThinBone) return {};
    double min_mm = std::numeric_limits<double>::infinity();
    int surface = -1;
    for (std::size_t n = 0; n < near_count_; ++n) {
      const double distance_mm =
          surfaces_[static_cast<std::size_t>(near_surfaces_[n])].surface->distance_mm(position);
      if (distance_mm < min_mm) {
        min_mm = distance_mm;
        surface = near_surfaces_[n];
      }
    }
    if (!(min_mm < 0)) return {};
    for (std::size_t n = 0; n < swept_count_; ++n) {
      min_mm = std::max(min_mm, swept_[n]->depth_mm(position));
      if (!(min_mm < 0)) return {};
    }
    Material material = owned(surface, position);
    if (counts_mm > 0) material.fraction *= std::clamp(-min_mm / counts_mm - 1, 0.0, 1.0);
    return material;
  }

  // share of the structures at a point of a surface that are not protected, and their mean energy
  Material owned(int surface, const Point<Patient>& position) const {
    double cut = 0, energy = 0;
    for (const OwnerFraction& fraction : owners_at(surfaces_, surface, position).all()) {
      const ContactSurface& structure = surfaces_[static_cast<std::size_t>(fraction.structure)];
      if (structure.is_protected) continue;
      cut += fraction.fraction;
      energy += fraction.fraction * structure.cutting_energy_mJ_per_mm3;
    }
    if (!(cut > 0)) return {};
    return {cut, energy / cut * ratio_at(position), kThick};
  }

  // material at a point by the voxels, in thin bone
  Material thin_before(const Point<Patient>& position) const {
    const std::array<int, 3> voxel = voxel_at(position);
    if (thinness(voxel) != kThinBone) return {};
    const Tissue* const tissue = voxels_->tissue_of(voxels_->labels->at(voxel[0], voxel[1], voxel[2]));
    // removed
    if (tissue == nullptr) return {};
    for (std::size_t n = 0; n < swept_count_; ++n)
      if (swept_[n]->depth_mm(position) >= 0) return {};
    return {1, tissue->cutting_energy_mJ_per_mm3 * ratio_at(position), kThin};
  }
  std::array<int, 3> voxel_at(const Point<Patient>& position) const {
    const Point<Voxel> voxel = burr_.model->labels->X_VoxelPatient() * position;
    return {static_cast<int>(std::lround(voxel.x())), static_cast<int>(std::lround(voxel.y())),
            static_cast<int>(std::lround(voxel.z()))};
  }
  // Model::density_ratios
  double ratio_at(const Point<Patient>& position) const {
    if (ratios_ == nullptr) return 1;
    const std::array<int, 3> voxel = voxel_at(position);
    return density_ratio_at(ratios_, voxel[0], voxel[1], voxel[2]);
  }
  // value of Model::thin_voxels
  std::uint8_t thinness(const std::array<int, 3>& voxel) const {
    return voxels_->thin_voxels->anywhere(voxel[0], voxel[1], voxel[2]);
  }
  static Vector<Patient> perpendicular(const Vector<Patient>& to) {
    const Eigen::Vector3d away = to.eigen().cwiseAbs();
    int smallest = 0;
    away.minCoeff(&smallest);
    return to.cross(Vector<Patient>(Eigen::Vector3d::Unit(smallest))).normalized();
  }

  static constexpr std::uint64_t kTurns = 1 << 20;  // number of ticks until the directions repeat
  static constexpr double kGoldenAngle = 2 * std::numbers::pi * (2 - std::numbers::phi);
  std::span<const ContactSurface> surfaces_;
  const Burr& burr_;
  const Vector<Patient> spindle_;
  const ToolSphere head_;
  const Point<Patient> at_;
  std::array<int, 8> near_surfaces_{};
  std::size_t near_count_ = 0;
  std::array<std::optional<SweptShape>, kMaxSweeps> swept_;
  std::size_t swept_count_ = 0;
  const Model* voxels_ = nullptr;                  // with thin bone in this layer; null: none
  const Bricks<std::uint16_t>* ratios_ = nullptr;  // null: by structure alone
  double turn_rad_ = 0;
};

// appends a path to the sweeps, or extends the last one; false if the capacity is exhausted
bool sweep(const BurrTool& burr, const HeadPose& from, const HeadPose& to, BurrState& state) {
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
    const ToolSphere head = burr.head(layer.attitude);
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
    const ToolSphere head = burr.head(proxy.layer(surface.layer).attitude);
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
  const ToolSphere was = burr.head(from.attitude), is = burr.head(to.attitude);
  Point<Patient> position = to.at;
  for (int n = 0; n < kCuttingSettings.max_iterations; ++n) {
    bool clear = true;
    for (const ProtectedStructure& structure : burr->protected_structures) {
      const Surface& surface = *structure.surface;
      if (!structure.is_protected || is_certainly_beyond(surface, is, position, burr->max_radius_mm()))
        continue;
      const NearestPart nearest = nearest_part(surface, is, position, burr->radius_mm);
      if (nearest.distance_mm >= burr->radius_mm) continue;
      const double min_mm =
          std::min(burr->radius_mm, nearest_part(surface, was, from.at, burr->radius_mm).distance_mm +
                                        kCuttingSettings.recovery_mm);
      const double correction_mm = min_mm - nearest.distance_mm;
      if (correction_mm <= kCuttingSettings.contact_tolerance_mm) continue;
      clear = false;
      position += surface.outward(position + is.axis_mm * nearest.axis_fraction) * correction_mm;
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

}  // namespace

ToolSphere Burr::head(double inset_mm) const {
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
  // Inset allowed by the motor's work in this tick, estimated from the last tick's press force.
  const bool cuts = burr.revolutions_per_s > 0 && !state.sweeps_full;
  const bool in_material = cuts && state.front_mm2 > 0 && std::isfinite(state.energy_mJ_per_mm3);
  const FeedVolume feed_volume(state.front_mm2, burr.max_radius_mm());
  const double mJ_per_N = in_material ? burr.grip * state.edge_mm_per_s * options.dt_s : 0;
  const double pressed_N = state.pressed_N, energy = state.energy_mJ_per_mm3;
  // the energy debt is worked off first
  const double spendable_mJ = std::max(0.0, state.unspent_work_mJ + mJ_per_N * pressed_N - state.debt_mJ);
  state.inset_mm = state.penetration_mm;
  if (in_material) {
    const double feed_mm = feed_volume.feed_mm(spendable_mJ / state.energy_mJ_per_mm3);
    state.inset_mm =
        std::min(state.penetration_mm + std::min(feed_mm, kCuttingSettings.max_feed_mm),
                 std::max(state.penetration_mm, kCuttingSettings.max_inset_fraction * burr.min_radius_mm()));
  }
  // a burr that does not cut must be able to leave by the path on which it entered
  if (!cuts) state.inset_mm = std::max(state.inset_mm, missing_clearance_mm(surfaces, burr_tool, proxy));
  if (!(burr.revolutions_per_s > 0)) state.sweep_closed = true;

  const int was_in = state.layer;
  std::array<HeadPose, kMaxLayers> before;
  std::array<bool, kMaxLayers> was_coupled{};
  for (int n = 0; n < kMaxLayers; ++n) {
    before[static_cast<std::size_t>(n)] = {proxy.layer(n).position, proxy.layer(n).attitude};
    was_coupled[static_cast<std::size_t>(n)] = proxy.layer(n).coupled;
  }
  const ToolSphere head = burr.head(state.inset_mm);
  // the motor's work limits the displacement, not the slip rate
  ProxyOptions guided = options;
  guided.max_slip_N_per_s = std::numeric_limits<double>::infinity();
  if (cuts) guided.max_distance_increase = kCuttingSettings.max_distance_increase;
  ProxyResult result = advance_proxy(surfaces, {&head, 1}, tool_pose, proxy, guided);
  for (std::size_t n = 0; n < before.size(); ++n) {
    ProxyLayer& layer = proxy.layer(static_cast<int>(n));
    if (burr.protected_structures.empty() || !layer.coupled || !was_coupled[n]) continue;
    const HeadPose pose = outside_protected(burr_tool, before[n], {layer.position, layer.attitude});
    const bool same = pose.at == layer.position && pose.attitude.coeffs() == layer.attitude.coeffs();
    if (!same) move_to(pose, tool_pose.tip, layer, result.of_layer[n], result);
  }
  state.penetration_mm = std::min(state.inset_mm, penetration_mm(surfaces, burr_tool, proxy));
  // a burr that has sunk in is in material even without a contact
  const int touched = innermost_touched(proxy);
  if (touched >= 0 || !(state.penetration_mm > 0)) state.layer = touched;
  const int is_in = state.layer;

  state.front_mm2 = 0;
  if (is_in < 0 || !cuts) {
    state.pressed_N = std::min(result.force_N.norm(), burr.max_press_N);
    state.unspent_work_mJ = 0;
    return result;
  }
  // The proxy does not move for displacements below its resolution: unspent work is accumulated, up to the
  // work that advances the burr by max_feed_mm.
  if (in_material) {
    const double now_N = std::min(result.force_N.norm(), burr.max_press_N);
    const double done_mJ = mJ_per_N * 0.5 * (pressed_N + now_N);
    const double work_mJ = done_mJ - pay_debt(done_mJ, state);
    const double unspent_work_mJ = std::min(state.unspent_work_mJ + work_mJ,
                                            energy * feed_volume.volume_mm3(kCuttingSettings.max_feed_mm));
    state.work_mJ += std::max(0.0, unspent_work_mJ - state.unspent_work_mJ);
    state.unspent_work_mJ = std::max(state.unspent_work_mJ, unspent_work_mJ);
  }
  const ProxyLayer& layer = proxy.layer(is_in);
  const HeadPose from = before[static_cast<std::size_t>(is_in)], to{layer.position, layer.attitude};
  const Vector<Patient> moved = to.at - from.at;
  const Vector<Patient> turned = burr_tool.head(to.attitude).axis_mm - burr_tool.head(from.attitude).axis_mm;
  const HeadDisplacement displacement(moved, moved + turned);
  if (was_in == is_in && displacement.length_mm > kCuttingSettings.at_rest_mm) {
    const HeadPose middle = burr_tool.interpolate(from, to, 0.5);
    const MaterialSampler between(surfaces, burr_tool, burr_tool.head(middle.attitude), layer, is_in,
                                  middle.at, state);
    CuttingFront swept = between.along(displacement);
    if (!(swept.area_mm2 > 0)) swept = between.thin_contact_front(layer, displacement);
    const double cost_mJ = swept.area_mm2 * displacement.length_mm * swept.energy_mJ_per_mm3;
    if (swept.area_mm2 > 0 && std::isfinite(cost_mJ)) {
      // motion through material is limited by the motor's work and by the capacity for sweeps
      double fraction = std::min(1.0, state.unspent_work_mJ / cost_mJ);
      const HeadPose there = outside_protected(burr_tool, from, burr_tool.interpolate(from, to, fraction));
      state.sweeps_full = fraction > 0 && !sweep(burr_tool, from, there, state);
      if (state.sweeps_full) fraction = 0;
      // all layers represent one burr: none may move ahead of the one that cuts
      for (std::size_t n = 0; n < before.size(); ++n) {
        ProxyLayer& layered = proxy.layer(static_cast<int>(n));
        if (!layered.coupled || layered.contact_count == 0) continue;
        const HeadPose pose =
            burr_tool.interpolate(before[n], {layered.position, layered.attitude}, fraction);
        move_to(outside_protected(burr_tool, before[n], pose), tool_pose.tip, layered, result.of_layer[n],
                result);
      }
      state.removed_mm3 += swept.area_mm2 * displacement.length_mm * fraction;
      state.unspent_work_mJ -= cost_mJ * fraction;
      if (fraction > 0) {
        auto& spent_mJ = state.spent_mJ[static_cast<std::size_t>(state.sweep_count - 1)];
        spent_mJ[kThin] += cost_mJ * fraction * swept.thin_fraction;
        spent_mJ[kThick] += cost_mJ * fraction * (1 - swept.thin_fraction);
      }
    }
  }
  state.pressed_N = std::min(result.force_N.norm(), burr.max_press_N);
  state.penetration_mm = std::min(state.inset_mm, penetration_mm(surfaces, burr_tool, proxy));
  if (burr.model != nullptr && burr.model->thin_voxels != nullptr) ++state.thin_ticks;

  const Vector<Patient> push = result.force_N * -1.0;
  if (!(push.norm() > 0)) return result;
  const MaterialSampler ahead(surfaces, burr_tool, burr_tool.head(layer.attitude), layer, is_in,
                              layer.position, state);
  CuttingFront front = ahead.along({push, push});
  if (!(front.area_mm2 > 0)) front = ahead.edge_contact_front(layer);
  if (!(front.area_mm2 > 0)) front = ahead.thin_contact_front(layer, {push, push});
  state.front_mm2 = front.area_mm2;
  state.edge_mm_per_s = front.edge_mm_per_s;
  state.energy_mJ_per_mm3 = front.energy_mJ_per_mm3;
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
