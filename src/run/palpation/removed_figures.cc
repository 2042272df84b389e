#include "palpate/palpation/palpation.h"
#include "palpate/tissue/protected_distance.h"
#include "palpate/tissue/removed_volume.h"

namespace palpate {

std::vector<RemovedFigure> removed_figures(const Model& model, const RemovedVolume& removed) {
  std::vector<RemovedFigure> figures;
  for (const auto& [label, mm3] : removed.by_label_mm3())
    figures.push_back({model.name_of(label), label, mm3});
  return figures;
}

std::vector<ProtectedFigure> protected_figures(const Model& model, const RemovedVolume& removed,
                                               const ProtectedDistanceMeter& meter) {
  const std::map<LabelId, double> removed_mm3 = removed.by_label_mm3();
  std::vector<ProtectedFigure> figures;
  for (const ProtectedStructure& structure : model.protected_structures) {
    ProtectedFigure figure{model.name_of(structure.label), structure.label, structure.is_protected, {}, 0};
    const auto nearest = meter.nearest_mm().find(structure.label);
    if (nearest != meter.nearest_mm().end()) figure.nearest_mm = nearest->second;
    const auto lost = removed_mm3.find(structure.label);
    if (lost != removed_mm3.end()) figure.removed_mm3 = lost->second;
    figures.push_back(std::move(figure));
  }
  return figures;
}

}  // namespace palpate
