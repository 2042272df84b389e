#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <span>

#include "palpate/tissue/bone_density.h"
#include "palpate/tissue/thin_voxels.h"
#include "palpate/tissue/tissue_settings.h"
#include "tissue/burr_head.h"

/// Samples the tissue in front of a burr: by the surfaces where bone is thick, by the voxels where it is
/// thin.
namespace palpate {

// Minimum depth in material of a sample that counts as cut: half of lookahead_mm. Beside a pocket, where the
// burr's surface leaves the material, the samples ahead of the surface are less deep and do not count.
inline constexpr double kMinSampleDepth_mm = kCuttingSettings.lookahead_mm / 2;

// whether a surface's bounds prove that no centre of the head's balls is within `within_mm`
inline bool is_certainly_beyond(const Surface& surface, const ToolSphere& head, const Point<Patient>& at,
                                double within_mm) {
  if (head.axis_mm == Vector<Patient>()) return surface.is_farther_than(at, within_mm);
  const Eigen::Array3d begin = at.eigen().array(), end = (at + head.axis_mm).eigen().array();
  return surface.is_farther_than(begin.min(end), begin.max(end), within_mm);
}

// whether no ball of the head, treated as if all had the first one's radius, is closer than `mm`
inline bool is_farther(const Surface& surface, const ToolSphere& head, const Point<Patient>& at, double mm) {
  const double wider_mm = std::max(0.0, head.radius_change_mm);
  const double beside_mm = 0.5 * head.axis_mm.norm() * surface.max_gradient();
  return surface.lower_bound_mm(at + head.axis_mm * 0.5) >= mm + wider_mm + beside_mm;
}

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
    for_directions(
        displacement, kCuttingSettings.thin_directions, kCuttingSettings.thin_directions, turn_rad_,
        [&](const Point<Patient>& centre, const Vector<Patient>& direction, double radius_mm,
            double share_mm2) {
          add(thin_material_at(centre + direction * (radius_mm + kCuttingSettings.thin_lookahead_mm)),
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
      Material material = cuttable_material(contact.surface, centre + inward * radius_mm);
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
    Material material = cuttable_material(surface, position);
    if (counts_mm > 0) material.fraction *= std::clamp(-min_mm / counts_mm - 1, 0.0, 1.0);
    return material;
  }

  // share of the structures at a point of a surface that are not protected, and their mean energy
  Material cuttable_material(int surface, const Point<Patient>& position) const {
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
  Material thin_material_at(const Point<Patient>& position) const {
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

}  // namespace palpate
