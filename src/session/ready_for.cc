#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

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

Error too_many(std::size_t structures, std::size_t outer) {
  std::string what = "the proxy takes at most " + std::to_string(kMostSurfaces) + " surfaces, and here are " +
                     std::to_string(structures) + " felt structures";
  if (outer > 0) what += " and " + std::to_string(outer) + " outer surfaces of those that touch";
  return {ErrorKind::kBadInput, what, "",
          "set felt = false on tissues that are not touched, or choose another method"};
}

// Which surfaces a model's structures need. Structures that touch have an outer surface in common. Where one
// of them can be gone through, those have surfaces of their own too, and what is left of the group another
// outer one.
class SurfacesNeeded {
 public:
  SurfacesNeeded(const Model& model, const std::vector<LabelId>& felt,
                 const std::vector<std::vector<LabelId>>& groups)
      : felt_(felt) {
    for (const LabelId label : felt) {
      const Tissue& tissue = *model.tissue_of(label);
      surfaces_.push_back({nullptr, tissue.stiffness_N_per_mm, tissue.static_friction,
                           tissue.friction_coefficient, tissue.puncture_N, nullptr, -1});
    }
    const auto can_be_gone_through = [&](LabelId label) {
      return std::isfinite(model.tissue_of(label)->puncture_N);
    };
    for (const std::vector<LabelId>& group : groups) {
      const int outer = add(group, -1);
      outermost_.push_back({group, outer});
      if (group.size() == 1) continue;
      for (const LabelId label : group) surfaces_[static_cast<std::size_t>(place_of(label))].beneath = outer;
      if (std::none_of(group.begin(), group.end(), can_be_gone_through)) continue;
      std::vector<LabelId> rest;
      for (const LabelId label : group) {
        if (can_be_gone_through(label))
          beneath_.push_back({{label}, add({label}, outer)});
        else
          rest.push_back(label);
      }
      if (!rest.empty()) beneath_.push_back({rest, add(rest, outer)});
    }
  }

  std::size_t structures() const { return felt_.size(); }
  std::size_t outer() const { return surfaces_.size() - felt_.size(); }

  /// The model's surfaces with their shapes. Errors: those of prepare_outer_surfaces.
  Result<std::vector<FeltSurface>> prepare(const Volume<LabelId>& labels, const Progress& progress) {
    for (const std::vector<Part>* parts : {&outermost_, &beneath_}) {
      if (parts->empty()) continue;
      std::vector<std::vector<LabelId>> groups;
      for (const Part& part : *parts) groups.push_back(part.structures);
      auto prepared = prepare_outer_surfaces(labels, groups, {}, progress);
      if (!prepared) return prepared.error();
      for (std::size_t n = 0; n < parts->size(); ++n) {
        const Part& part = (*parts)[n];
        FeltSurface& felt = surfaces_[static_cast<std::size_t>(part.surface)];
        felt.surface = std::make_shared<const Surface>(std::move((*prepared)[n].surface));
        if (part.structures.size() > 1) felt.owners = owners_of(part.structures, labels);
      }
    }
    return surfaces_;
  }

 private:
  struct Part {
    std::vector<LabelId> structures;
    int surface;
  };

  int place_of(LabelId label) const {
    return static_cast<int>(std::lower_bound(felt_.begin(), felt_.end(), label) - felt_.begin());
  }

  // where the surface of some structures stands; one alone has its place already
  int add(const std::vector<LabelId>& structures, int beneath) {
    int place = static_cast<int>(surfaces_.size());
    if (structures.size() == 1)
      place = place_of(structures.front());
    else
      surfaces_.emplace_back();
    surfaces_[static_cast<std::size_t>(place)].beneath = beneath;
    return place;
  }

  std::shared_ptr<const Owners> owners_of(const std::vector<LabelId>& structures,
                                          const Volume<LabelId>& labels) const {
    std::vector<std::int16_t> structure_of_label(std::numeric_limits<LabelId>::max() + std::size_t{1}, -1);
    for (const LabelId label : structures)
      structure_of_label[label] = static_cast<std::int16_t>(place_of(label));
    return std::make_shared<const Owners>(labels, structure_of_label);
  }

  const std::vector<LabelId>& felt_;
  std::vector<FeltSurface> surfaces_;
  std::vector<Part> outermost_, beneath_;
};

Result<std::shared_ptr<const Model>> with_surfaces(std::shared_ptr<const Model> model,
                                                   const Progress& progress) {
  const std::vector<LabelId> felt = felt_structures(*model);
  if (felt.size() > kMostSurfaces) return too_many(felt.size(), 0);
  const auto groups = touching_groups(*model->labels, felt, 0, progress);
  if (!groups) return groups.error();
  SurfacesNeeded needed(*model, felt, *groups);
  if (needed.structures() + needed.outer() > kMostSurfaces)
    return too_many(needed.structures(), needed.outer());
  auto surfaces = needed.prepare(*model->labels, progress);
  if (!surfaces) return surfaces.error();
  auto more = std::make_shared<Model>(*model);
  more->surfaces = *std::move(surfaces);
  more->label_of_surface = felt;
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
