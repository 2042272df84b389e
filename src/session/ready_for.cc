#include <algorithm>

#include "palpate/session.h"
#include "palpate/surfaces.h"

namespace palpate {
namespace {

// every label that is felt and has voxels, ascending
std::vector<LabelId> felt_structures(const Model& model) {
  std::vector<char> there(model.tissue_of_label.size(), 0);
  for (const LabelId label : model.labels->voxels())
    if (model.is_felt(label)) there[label] = 1;
  std::vector<LabelId> felt;
  for (std::size_t label = 1; label < there.size(); ++label)
    if (there[label]) felt.push_back(static_cast<LabelId>(label));
  return felt;
}

FeltSurface felt_surface(const Tissue& tissue, Surface surface) {
  return {std::make_shared<const Surface>(std::move(surface)), tissue.stiffness_N_per_mm,
          tissue.static_friction, tissue.friction_coefficient, tissue.puncture_N};
}

Result<std::shared_ptr<const Model>> with_surfaces(std::shared_ptr<const Model> model,
                                                   const Progress& progress) {
  const std::vector<LabelId> felt = felt_structures(*model);
  if (felt.size() > kMostSurfaces)
    return Error{ErrorKind::kBadInput,
                 "the proxy takes at most " + std::to_string(kMostSurfaces) +
                     " felt structures, and here are " + std::to_string(felt.size()),
                 "", "set felt = false on tissues that are not touched, or choose another method"};
  auto prepared = prepare_surfaces(*model->labels, felt, {}, progress);
  if (!prepared) return prepared.error();
  auto more = std::make_shared<Model>(*model);
  for (PreparedSurface& surface : *prepared) {
    more->surfaces.push_back(felt_surface(*model->tissue_of(surface.label), std::move(surface.surface)));
    more->label_of_surface.push_back(surface.label);
  }
  return std::shared_ptr<const Model>(std::move(more));
}

}  // namespace

Result<std::shared_ptr<const Model>> ready_for(std::shared_ptr<const Model> model,
                                               std::span<const ForceMethod> methods,
                                               const Progress& progress) {
  std::vector<ForceMethod> direct(methods.begin(), methods.end());
  const bool proxy = std::erase(direct, ForceMethod::kProxy) > 0;
  auto ready = with_methods(std::move(model), direct, progress);
  if (!ready || !proxy || (*ready)->has(ForceMethod::kProxy)) return ready;
  return with_surfaces(*std::move(ready), progress);
}

}  // namespace palpate
