#include "palpate/tissue/cutting_energy.h"

#include <algorithm>

#include "tissue/swept_voxels.h"

namespace palpate {

CuttingEnergy::CuttingEnergy(const Model& model) : density_ratios_(model.density_ratios) {
  std::vector<bool> has_energy = cuttable_labels(model);
  int innermost = 0;
  for (std::size_t n = 0; n < model.label_of_surface.size(); ++n)
    innermost = std::max(innermost, model.surfaces[n].layer);
  for (std::size_t n = 0; n < model.label_of_surface.size(); ++n)
    if (model.surfaces[n].layer < innermost) has_energy[model.label_of_surface[n]] = false;
  std::vector<double> energies(model.tissue_of_label.size());
  for (std::size_t label = 0; label < energies.size(); ++label)
    if (has_energy[label])
      energies[label] = model.tissue_of(static_cast<LabelId>(label))->cutting_energy_mJ_per_mm3;
  has_energy_ = std::make_shared<const std::vector<bool>>(std::move(has_energy));
  energy_of_label_ = std::make_shared<const std::vector<double>>(std::move(energies));
}

}  // namespace palpate
