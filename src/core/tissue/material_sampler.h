#pragma once

#include <array>
#include <numbers>
#include <optional>
#include <span>

#include "palpate/tissue/bone_density.h"
#include "tissue/burr_head.h"

/// Samples the tissue in front of a burr: by the surfaces where bone is thick, by the voxels where it is
/// thin.
namespace palpate {

/// Whether a surface's bounds prove that no centre of the head's balls is within `within_mm`
bool is_certainly_beyond(const Surface& surface, const ToolPart& head, const Point<Patient>& at,
                         double within_mm);
/// Whether the lower bound of the distance field proves for every ball of the head that the distance of its
/// centre, minus the excess of its radius over the first ball's, is at least `mm`. Conservative: may be false
/// where that holds.
bool is_farther(const Surface& surface, const ToolPart& head, const Point<Patient>& at, double mm);

/// Material directly in front of a burr, projected along its displacement.
struct CuttingFront {
  double area_mm2 = 0;
  double edge_speed_mm_s = 0;    // mean over the area
  double energy_mJ_per_mm3 = 0;  // mean over the area
  double thin_fraction = 0;      // fraction of the energy that is of thin bone
};

/// Samples the material around a burr's head.
class MaterialSampler {
 public:
  /// @param head  at the layer's attitude
  /// @param at    position of the head in that layer
  MaterialSampler(std::span<const ContactSurface> surfaces, const BurrTool& burr, const ToolPart& head,
                  const ProxyLayer& layer, int number, const Point<Patient>& at, const BurrState& state);

  CuttingFront along(const HeadDisplacement& displacement) const;

  /// Estimate for a burr resting on an edge, such as the rim of a groove, where no sampling point is deep
  /// enough to count: each contact contributes as much as one sampling direction.
  CuttingFront edge_contact_front(const ProxyLayer& layer) const;

  /// edge_contact_front() for thin bone: a burr in contact with thin bone that no sampling direction hits.
  /// @param displacement  only its part into the contact counts
  CuttingFront thin_contact_front(const ProxyLayer& layer, const HeadDisplacement& displacement) const;

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

  CuttingFront front_of(const Sum& sum) const;

  // Calls run(centre, direction, radius_mm, share_mm2) for directions ahead, where share_mm2 is the area of
  // the head that each represents, projected along the displacement.
  // @param turn_rad  of the directions about the displacement, and about the axis
  template <class Run>
  void for_directions(const HeadDisplacement& displacement, int end_samples, int lateral_samples,
                      double turn_rad, const Run& run) const;

  // the hemisphere of one end, except where the rest of the head covers it
  template <class Run>
  void for_end_cap(std::size_t end, const HeadDisplacement& displacement, int directions, double turn_rad,
                   const Run& run) const;

  // the lateral surface, which is straight along the axis
  template <class Run>
  void for_lateral_surface(const HeadDisplacement& displacement, int samples, double turn_rad,
                           const Run& run) const;

  void add(const Material& material, const Vector<Patient>& direction, double radius_mm, double share_mm2,
           Sum& sum) const;

  // material at a point by the surfaces
  // @param counts_mm  depth in material at which a point begins to count
  Material material_at(const Point<Patient>& position, double counts_mm) const;

  // share of the structures at a point of a surface that are not protected, and their mean energy
  Material cuttable_material(int surface, const Point<Patient>& position) const;

  // material at a point by the voxels, in thin bone
  Material thin_material_at(const Point<Patient>& position) const;
  std::array<int, 3> voxel_at(const Point<Patient>& position) const;
  // Model::density_ratios
  double ratio_at(const Point<Patient>& position) const;
  // value of Model::thin_voxels
  std::uint8_t thinness(const std::array<int, 3>& voxel) const;
  static Vector<Patient> perpendicular(const Vector<Patient>& to);

  static constexpr std::uint64_t kTurns = 1 << 20;  // number of ticks until the directions repeat
  static constexpr double kGoldenAngle = 2 * std::numbers::pi * (2 - std::numbers::phi);
  std::span<const ContactSurface> surfaces_;
  const Burr& burr_;
  const Vector<Patient> spindle_;
  const ToolPart head_;
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
