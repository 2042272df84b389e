#pragma once

#include <vector>

#include "palpate/contact/model.h"
#include "palpate/tissue/bone_density.h"

namespace palpate {

/// Specific cutting energy of a model's voxels, for the energy account of a burr. It covers the structures in
/// the innermost layer of contact that can be cut: a burr works on those, and softer structures around them
/// are displaced.
class CuttingEnergy {
 public:
  explicit CuttingEnergy(const Model& model);

  /// Whether each possible label is in the account.
  const std::vector<bool>& has_energy() const { return *has_energy_; }
  /// Specific energy of voxel (i, j, k), mJ/mm3.
  /// @param label  of the voxel before any removal; has an energy
  double mJ_per_mm3(LabelId label, int i, int j, int k) const {
    return (*energy_of_label_)[label] * density_ratio_at(density_ratios_.get(), i, j, k);
  }

 private:
  std::shared_ptr<const std::vector<bool>> has_energy_;
  std::shared_ptr<const std::vector<double>> energy_of_label_;   // mJ/mm3, up to the highest label in use
  std::shared_ptr<const Bricks<std::uint16_t>> density_ratios_;  // may be null
};

}  // namespace palpate
