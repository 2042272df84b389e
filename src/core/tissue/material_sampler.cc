#include "tissue/material_sampler.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "palpate/tissue/thin_voxels.h"
#include "palpate/tissue/tissue_settings.h"

namespace palpate {
namespace {

// Minimum depth in material of a sample that counts as cut: half of lookahead_mm. Beside a pocket, where the
// burr's surface leaves the material, the samples ahead of the surface are less deep and do not count.
constexpr double kMinSampleDepth_mm = kCuttingSettings.lookahead_mm / 2;

}  // namespace

bool is_certainly_beyond(const Surface& surface, const ToolPart& head, const Point<Patient>& at,
                         double within_mm) {
  if (head.axis_mm == Vector<Patient>()) return surface.is_farther_than(at, within_mm);
  const Eigen::Array3d begin = at.eigen().array(), end = (at + head.axis_mm).eigen().array();
  return surface.is_farther_than(begin.min(end), begin.max(end), within_mm);
}

bool is_farther(const Surface& surface, const ToolPart& head, const Point<Patient>& at, double mm) {
  const double wider_mm = std::max(0.0, head.radius_change_mm);
  const double beside_mm = 0.5 * head.axis_mm.norm() * surface.max_gradient();
  return surface.lower_bound_mm(at + head.axis_mm * 0.5) >= mm + wider_mm + beside_mm;
}

MaterialSampler::MaterialSampler(std::span<const ContactSurface> surfaces, const BurrTool& burr,
                                 const ToolPart& head, const ProxyLayer& layer, int number,
                                 const Point<Patient>& at, const BurrState& state)
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

CuttingFront MaterialSampler::along(const HeadDisplacement& displacement) const {
  if (near_count_ == 0) return {};
  Sum sum;
  for_directions(
      displacement, kCuttingSettings.directions, kCuttingSettings.lateral_samples, 0,
      [&](const Point<Patient>& centre, const Vector<Patient>& direction, double radius_mm,
          double share_mm2) {
        add(material_at(centre + direction * (radius_mm + kCuttingSettings.lookahead_mm), kMinSampleDepth_mm),
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

CuttingFront MaterialSampler::edge_contact_front(const ProxyLayer& layer) const {
  if (near_count_ == 0) return {};
  Sum sum;
  for (int n = 0; n < layer.contact_count; ++n) {
    const ProxyContact& contact = layer.contacts[static_cast<std::size_t>(n)];
    const Point<Patient> centre = at_ + head_.axis_mm * contact.axis_fraction;
    // the contact normal is smoothed and may point past the edge
    const ContactSurface& surface = surfaces_[static_cast<std::size_t>(contact.surface)];
    const Vector<Patient> outward =
        sample_central_differences(surface.surface->distance_field(), centre).gradient.normalized();
    // between voxels the distance to the edge may be underestimated
    const double radius_mm = head_.radius_at_mm(contact.axis_fraction);
    const Point<Patient> start = centre - outward * surface.clearance_error_mm;
    add(material_at(start + -outward * (radius_mm + kCuttingSettings.lookahead_mm), 0), -outward, radius_mm,
        std::numbers::pi * radius_mm * radius_mm / kCuttingSettings.directions, sum);
  }
  return front_of(sum);
}

CuttingFront MaterialSampler::thin_contact_front(const ProxyLayer& layer,
                                                 const HeadDisplacement& displacement) const {
  if (near_count_ == 0 || voxels_ == nullptr) return {};
  Sum sum;
  for (int n = 0; n < layer.contact_count; ++n) {
    const ProxyContact& contact = layer.contacts[static_cast<std::size_t>(n)];
    const Point<Patient> centre = at_ + head_.axis_mm * contact.axis_fraction;
    const ContactSurface& surface = surfaces_[static_cast<std::size_t>(contact.surface)];
    const Vector<Patient> inward =
        -sample_central_differences(surface.surface->distance_field(), centre).gradient.normalized();
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

CuttingFront MaterialSampler::front_of(const Sum& sum) const {
  if (!(sum.area_mm2 > 0)) return {};
  const double peripheral_speed_mm_s = 2 * std::numbers::pi * burr_.revolutions_per_s * burr_.radius_mm;
  return {sum.area_mm2, peripheral_speed_mm_s * sum.speed / sum.area_mm2, sum.energy / sum.area_mm2,
          sum.thin_energy > 0 ? sum.thin_energy / sum.energy : 0};
}

template <class Run>
void MaterialSampler::for_directions(const HeadDisplacement& displacement, int end_samples,
                                     int lateral_samples, double turn_rad, const Run& run) const {
  const bool is_ball = head_.axis_mm == Vector<Patient>();
  for (std::size_t end = 0; end < (is_ball ? 1 : 2); ++end)
    if (displacement.fraction[end] > 0) for_end_cap(end, displacement, end_samples, turn_rad, run);
  if (!is_ball) for_lateral_surface(displacement, lateral_samples, turn_rad, run);
}

template <class Run>
void MaterialSampler::for_end_cap(std::size_t end, const HeadDisplacement& displacement, int directions,
                                  double turn_rad, const Run& run) const {
  const double along_row = end == 0 ? 0 : 1, radius_mm = head_.radius_at_mm(along_row);
  const Vector<Patient>& ahead = displacement.along[end];
  const Vector<Patient> side = perpendicular(ahead), up = ahead.cross(side);
  const double share_mm2 = std::numbers::pi * radius_mm * radius_mm / directions * displacement.fraction[end];
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

template <class Run>
void MaterialSampler::for_lateral_surface(const HeadDisplacement& displacement, int samples, double turn_rad,
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
    const Vector<Patient> direction = axis * -slope + (side * std::cos(turn) + up * std::sin(turn)) * cosine;
    const double ahead = direction.dot(paths[0] * (1 - fraction) + paths[1] * fraction);
    if (!(ahead > 0)) continue;
    const double radius_mm = head_.radius_at_mm(fraction);
    const double share_mm2 = 2 * std::numbers::pi * radius_mm * cosine * cosine * length_mm / samples;
    run(at_ + head_.axis_mm * fraction, direction, radius_mm, share_mm2 * ahead);
  }
}

void MaterialSampler::add(const Material& material, const Vector<Patient>& direction, double radius_mm,
                          double share_mm2, Sum& sum) const {
  if (!(material.fraction > 0)) return;
  const double area_mm2 = share_mm2 * material.fraction;
  sum.area_mm2 += area_mm2;
  sum.speed += area_mm2 * spindle_.cross(direction).norm() * (radius_mm / burr_.radius_mm);
  sum.energy += area_mm2 * material.energy;
  if (material.bone == kThin) sum.thin_energy += area_mm2 * material.energy;
}

MaterialSampler::Material MaterialSampler::material_at(const Point<Patient>& position,
                                                       double counts_mm) const {
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

MaterialSampler::Material MaterialSampler::cuttable_material(int surface,
                                                             const Point<Patient>& position) const {
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

MaterialSampler::Material MaterialSampler::thin_material_at(const Point<Patient>& position) const {
  const std::array<int, 3> voxel = voxel_at(position);
  if (thinness(voxel) != kThinBone) return {};
  const Tissue* const tissue = voxels_->tissue_of(voxels_->labels->at(voxel[0], voxel[1], voxel[2]));
  // removed
  if (tissue == nullptr) return {};
  for (std::size_t n = 0; n < swept_count_; ++n)
    if (swept_[n]->depth_mm(position) >= 0) return {};
  return {1, tissue->cutting_energy_mJ_per_mm3 * ratio_at(position), kThin};
}

std::array<int, 3> MaterialSampler::voxel_at(const Point<Patient>& position) const {
  const Point<Voxel> voxel = burr_.model->labels->X_VoxelPatient() * position;
  return {static_cast<int>(std::lround(voxel.x())), static_cast<int>(std::lround(voxel.y())),
          static_cast<int>(std::lround(voxel.z()))};
}

double MaterialSampler::ratio_at(const Point<Patient>& position) const {
  if (ratios_ == nullptr) return 1;
  const std::array<int, 3> voxel = voxel_at(position);
  return density_ratio_at(ratios_, voxel[0], voxel[1], voxel[2]);
}

std::uint8_t MaterialSampler::thinness(const std::array<int, 3>& voxel) const {
  return voxels_->thin_voxels->anywhere(voxel[0], voxel[1], voxel[2]);
}

Vector<Patient> MaterialSampler::perpendicular(const Vector<Patient>& to) {
  const Eigen::Vector3d away = to.eigen().cwiseAbs();
  int smallest = 0;
  away.minCoeff(&smallest);
  return to.cross(Vector<Patient>(Eigen::Vector3d::Unit(smallest))).normalized();
}

}  // namespace palpate
