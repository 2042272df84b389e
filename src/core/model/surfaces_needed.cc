#include "model/surfaces_needed.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <utility>
#include <vector>

#include "model/surface_reach.h"
#include "palpate/model/stiffness_layers.h"
#include "palpate/surfaces/surfaces.h"
#include "palpate/tissue/bone_density.h"
#include "palpate/tissue/thin_voxels.h"

namespace palpate {
namespace {

// touchable labels that have voxels, ascending
std::vector<LabelId> touchable_structures(const Model& model) {
  const std::vector<std::size_t> voxels = label_counts(*model.labels);
  std::vector<LabelId> touchable;
  for (std::size_t label = 1; label < voxels.size(); ++label)
    if (voxels[label] > 0 && model.is_touchable(static_cast<LabelId>(label)))
      touchable.push_back(static_cast<LabelId>(label));
  return touchable;
}

Error too_many(std::size_t structures, std::size_t common) {
  std::string what = "the proxy takes at most " + std::to_string(kMaxSurfaces) +
                     " surfaces, but the scene has " + std::to_string(structures) + " touchable structures";
  if (common > 0) what += " and " + std::to_string(common) + " surfaces shared by structures in contact";
  return {ErrorKind::kBadInput, what, "",
          "set touchable = false on tissues that are not touched, or choose another method"};
}

// Upper stiffness bounds of a group's layers, softest first; a structure belongs to the first bound not below
// it.
std::vector<double> layer_bounds(std::vector<double> stiffnesses) {
  std::vector<double> bounds;
  for (const StiffnessRange& layer : stiffness_layers(std::move(stiffnesses)))
    bounds.push_back(layer.max_N_per_mm);
  return bounds;
}

// Surfaces that a model's structures need. Structures that touch have a common surface; those stiffer than
// the softest form groups of their own, or stand alone, one layer deeper, and so on. Structures that can be
// punctured get an additional surface of their own in each of their layers, and the remaining ones another
// common surface.
class SurfacesNeeded {
 public:
  SurfacesNeeded(const Model& model, const std::vector<LabelId>& touchable,
                 const std::vector<std::pair<LabelId, LabelId>>& touching)
      : model_(model), touchable_(touchable), touching_(touching) {
    for (const LabelId label : touchable)
      if (is_deformable(label)) softest_ = std::min(softest_, model.tissue_of(label)->stiffness_N_per_mm);
    for (const LabelId label : touchable) {
      const Tissue& tissue = *model.tissue_of(label);
      ContactSurface structure;
      static_cast<ContactProperties&>(structure) = tissue;
      structure.stiffness_N_per_mm = stiffness_of(label);
      if (is_deformable(label)) {
        structure.plane_strain_modulus_N_per_mm2 = contact_modulus_N_per_mm2(*tissue.elastic);
        structure.relaxed.add(tissue.relaxation, model.relaxation_times, 1);
      }
      structure.puncture_N = tissue.puncture_N;
      structure.stays_open = tissue.stays_open;
      structure.cutting_energy_mJ_per_mm3 = tissue.cutting_energy_mJ_per_mm3;
      structure.is_protected = model.has_burr() && tissue.protection == Protection::kBlock;
      surfaces_.push_back(structure);
    }
    for (const std::vector<LabelId>& group : touching_groups(touchable, touching)) {
      std::vector<double> stiffnesses;
      for (const LabelId label : group) stiffnesses.push_back(stiffness_of(label));
      add_layer(group, 0, 0, layer_bounds(std::move(stiffnesses)));
    }
  }

  std::size_t structures() const { return touchable_.size(); }
  std::size_t common() const { return surfaces_.size() - touchable_.size(); }

  /// Groups of structures to build surfaces from, in building order.
  std::vector<std::vector<LabelId>> groups() const {
    std::vector<std::vector<LabelId>> all;
    for (const auto& [together, parts] : parts_)
      for (const Part& part : parts)
        if (std::find(all.begin(), all.end(), part.structures) == all.end()) all.push_back(part.structures);
    return all;
  }

  /// The model's surfaces with their geometry. Errors: those of prepare_outer_surfaces.
  Result<std::vector<ContactSurface>> prepare(const Bricks<LabelId>& labels,
                                              const ModelPreparation& preparation, const Progress& progress) {
    const std::vector<std::vector<LabelId>> all = groups();
    const auto options = touchable_surface_options(model_.tools, labels.geometry());
    if (!options) return options.error();
    const auto prepared = preparation.outer_surfaces(labels, all, *options, progress);
    if (!prepared) return prepared.error();
    for (const auto& [together, parts] : parts_)
      for (const Part& part : parts) {
        const auto group = std::find(all.begin(), all.end(), part.structures) - all.begin();
        surfaces_[static_cast<std::size_t>(part.surface)].surface =
            (*prepared)[static_cast<std::size_t>(group)];
      }
    if (!add_owners(labels, progress)) return Progress::interrupted();
    return surfaces_;
  }

 private:
  struct Part {
    std::vector<LabelId> structures;
    int surface;
  };

  // deformable tissues form a single layer with the softest one's stiffness, which only determines its order
  bool is_deformable(LabelId label) const { return model_.is_deformable(*model_.tissue_of(label)); }
  double stiffness_of(LabelId label) const {
    return is_deformable(label) ? softest_ : model_.tissue_of(label)->stiffness_N_per_mm;
  }
  int index_of(LabelId label) const {
    return static_cast<int>(std::lower_bound(touchable_.begin(), touchable_.end(), label) -
                            touchable_.begin());
  }

  // assigns structures that touch, and are stiffer than the layer around them, to a layer
  void add_layer(const std::vector<LabelId>& group, int layer, double from, std::vector<double> bounds) {
    const auto is_above = [&](LabelId label) { return stiffness_of(label) > bounds.front(); };
    while (bounds.size() > 1 && std::all_of(group.begin(), group.end(), is_above))
      bounds.erase(bounds.begin());
    const double to = bounds.size() == 1 ? std::numeric_limits<double>::infinity() : bounds.front();
    bounds.erase(bounds.begin());
    std::vector<LabelId> stiffer;
    for (const LabelId label : group) {
      if (stiffness_of(label) > to)
        stiffer.push_back(label);
      else
        surfaces_[static_cast<std::size_t>(index_of(label))].layer = layer;
    }
    add_surfaces(group, layer, from, to);
    for (const std::vector<LabelId>& within : touching_groups(stiffer, touching_))
      add_layer(within, layer + 1, to, bounds);
  }

  void add_surfaces(const std::vector<LabelId>& group, int layer, double from, double to) {
    const int common = add(group, layer, from, to, -1);
    parts_[{layer, false}].push_back({group, common});
    if (group.size() == 1) return;
    std::vector<LabelId> remaining;
    for (const LabelId label : group) {
      const int structure = index_of(label);
      if (!std::isfinite(model_.tissue_of(label)->puncture_N)) {
        remaining.push_back(label);
        continue;
      }
      parts_[{layer, true}].push_back({{label}, add({label}, layer, from, to, common)});
      surfaces_[static_cast<std::size_t>(common)].opened_by.push_back(static_cast<std::int16_t>(structure));
    }
    if (remaining.size() == group.size() || remaining.empty()) return;
    parts_[{layer, true}].push_back({remaining, add(remaining, layer, from, to, common)});
  }

  // Index of the surface of some structures. A structure's own index is used in the layer it belongs to.
  int add(const std::vector<LabelId>& structures, int layer, double from, double to, int covered_by) {
    const int structure = structures.size() == 1 ? index_of(structures.front()) : -1;
    const bool own = structure >= 0 && stiffness_of(structures.front()) <= to;
    const int index = own ? structure : static_cast<int>(surfaces_.size());
    if (!own) surfaces_.emplace_back();
    ContactSurface& surface = surfaces_[static_cast<std::size_t>(index)];
    surface.structure = own ? -1 : structure;
    surface.covered_by = covered_by;
    surface.layer = layer;
    surface.lower_N_per_mm = from;
    surface.upper_N_per_mm = to;
    return index;
  }

  // each call scans the whole volume on all threads; false: interrupted
  bool add_owners(const Bricks<LabelId>& labels, const Progress& progress) {
    for (const auto& [together, parts] : parts_)
      for (const Part& part : parts) {
        if (part.structures.size() == 1) continue;
        if (progress.stopped()) return false;
        surfaces_[static_cast<std::size_t>(part.surface)].owners = owners_of(part.structures, labels);
      }
    return true;
  }

  std::shared_ptr<const Owners> owners_of(const std::vector<LabelId>& structures,
                                          const Bricks<LabelId>& labels) const {
    std::vector<std::int16_t> structure_of_label(std::numeric_limits<LabelId>::max() + std::size_t{1}, -1);
    for (const LabelId label : structures)
      structure_of_label[label] = static_cast<std::int16_t>(index_of(label));
    return std::make_shared<const Owners>(labels, structure_of_label);
  }

  const Model& model_;
  const std::vector<LabelId>& touchable_;
  const std::vector<std::pair<LabelId, LabelId>>& touching_;
  double softest_ = std::numeric_limits<double>::infinity();  // least stiffness of deformable tissues
  std::vector<ContactSurface> surfaces_;
  // key: layer, and whether the surface lies beneath one that can be punctured
  std::map<std::pair<int, bool>, std::vector<Part>> parts_;
};

// range of the distance between a burr and a protected structure, from the centre of its ball
constexpr double kReportedWithin_mm = 10;

// structures that a burr must not cut, each with its own surface, whether or not it touches others
Result<std::vector<ProtectedStructure>> protected_structures(const Model& model,
                                                             const std::vector<LabelId>& touchable,
                                                             const ModelPreparation& preparation,
                                                             const Progress& progress) {
  std::vector<ProtectedStructure> structures;
  if (!model.has_burr()) return structures;
  std::vector<std::vector<LabelId>> single_groups;
  for (const LabelId label : touchable) {
    const Protection protection = model.tissue_of(label)->protection;
    if (protection == Protection::kNone) continue;
    single_groups.push_back({label});
    structures.push_back({label, nullptr, protection == Protection::kBlock});
  }
  if (structures.empty()) return structures;
  auto surfaces =
      preparation.outer_surfaces(*model.labels, single_groups, {.reach_mm = kReportedWithin_mm}, progress);
  if (!surfaces) return surfaces.error();
  for (std::size_t n = 0; n < structures.size(); ++n) structures[n].surface = std::move((*surfaces)[n]);
  return structures;
}

}  // namespace

Result<std::shared_ptr<const Model>> with_surfaces(std::shared_ptr<const Model> model,
                                                   const ModelPreparation& preparation,
                                                   const Progress& progress) {
  const std::vector<LabelId> touchable = touchable_structures(*model);
  if (touchable.size() > kMaxSurfaces) return too_many(touchable.size(), 0);
  const auto touching = preparation.touching_pairs(*model->labels, touchable, progress);
  if (!touching) return touching.error();
  SurfacesNeeded needed(*model, touchable, *touching);
  if (needed.structures() + needed.common() > kMaxSurfaces)
    return too_many(needed.structures(), needed.common());
  auto surfaces = needed.prepare(*model->labels, preparation, progress);
  if (!surfaces) return surfaces.error();
  auto protected_ones = protected_structures(*model, touchable, preparation, progress);
  if (!protected_ones) return protected_ones.error();
  auto next = std::make_shared<Model>(*model);
  next->protected_structures = *std::move(protected_ones);
  next->surfaces = *std::move(surfaces);
  next->label_of_surface = touchable;
  set_strain_stiffening(*next);
  next->thin_voxels = next->has_burr() ? thin_voxels_of(*next) : nullptr;
  next->density_ratios = next->has_burr() ? density_ratios_of(*next) : nullptr;
  return std::shared_ptr<const Model>(std::move(next));
}

void set_strain_stiffening(Model& model) {
  const bool stiffens = model.tissue_law == TissueLaw::kExponential;
  for (std::size_t n = 0; n < model.label_of_surface.size(); ++n) {
    const auto& elastic = model.tissue_of(model.label_of_surface[n])->elastic;
    model.surfaces[n].strain_stiffening = stiffens && elastic ? elastic->stiffening : 0;
  }
}

Result<std::vector<std::vector<LabelId>>> surfaces_needed(const Model& model,
                                                          const ModelPreparation& preparation,
                                                          const Progress& progress) {
  const std::vector<LabelId> touchable = touchable_structures(model);
  if (touchable.size() > kMaxSurfaces) return too_many(touchable.size(), 0);
  const auto touching = preparation.touching_pairs(*model.labels, touchable, progress);
  if (!touching) return touching.error();
  const SurfacesNeeded needed(model, touchable, *touching);
  if (needed.structures() + needed.common() > kMaxSurfaces)
    return too_many(needed.structures(), needed.common());
  return needed.groups();
}

}  // namespace palpate
