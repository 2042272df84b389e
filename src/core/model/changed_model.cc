#include "palpate/model/changed_model.h"

#include <algorithm>
#include <cmath>

#include "model/relaxation_times.h"
#include "model/surfaces_needed.h"
#include "palpate/base/hash.h"
#include "palpate/contact/tissue_values.h"
#include "palpate/direct/direct_methods.h"
#include "palpate/model/make_model.h"
#include "palpate/tissue/fragments.h"

namespace palpate {
namespace {

void apply_to_surfaces(int index, const Tissue& tissue, Model& model) {
  for (std::size_t s = 0; s < model.label_of_surface.size(); ++s) {
    if (model.tissue_of_label[model.label_of_surface[s]] != index) continue;
    static_cast<ContactProperties&>(model.surfaces[s]) = tissue;
  }
}

// scales the existing trilinear field down if the stiffest tissue is now softer than when it was computed
std::shared_ptr<const ForceField> scaled_trilinear(const Model& current, const Model& prepared) {
  const double fraction = std::min(1.0, current.max_stiffness_N_per_mm() / prepared.max_stiffness_N_per_mm());
  const double full_force_N = prepared.force_field(ForceMethod::kTrilinear).full_force_N() * fraction;
  return std::make_shared<const ForceField>(prepared.field, full_force_N);
}

// sets the hashes of the version after a change
void hash_after(const Model& current, const ModelChange& change, Model& next) {
  std::uint64_t hash = current.hash_before_removal;
  hash_word(hash, change.tissue);
  for (const ContactProperty& property : kContactProperties)
    hash_double(hash, change.contact.*property.value);
  next.hash_before_removal = hash_finish(hash);
  next.content_hash = next.carving != nullptr ? next.carving->content_hash(next.hash_before_removal)
                                              : next.hash_before_removal;
}

Result<std::shared_ptr<const Model>> next_law(const Model& current, const ModelChange& change,
                                              const ModelPreparation& preparation, const Progress& progress) {
  // a file may contain any value
  const double cell_factor = change.contact.stiffness_N_per_mm;
  if (cell_factor != 0 && !(cell_factor >= 1 && cell_factor <= kMaxTissueCellFactor))
    return Error{ErrorKind::kBadInput, "the coarsening factor of the cells is " + std::to_string(cell_factor),
                 "", "give a factor from 1 to 2"};
  auto under = under_law(current, law_of(change), preparation, progress);
  if (!under) return under.error();
  return with_law(current, **under, change);
}

// whether a cut can be applied: a device, a path and a head of finite size
bool is_cut(const Cut& cut) {
  const Sweep& sweep = cut.sweep;
  constexpr double kMax_mm = 1e6, kMaxRadius_mm = 1e3;
  const auto is_valid_position = [](const auto& at) { return at.eigen().cwiseAbs().maxCoeff() <= kMax_mm; };
  return (cut.device < kMaxDevices || cut.device == Cut::kBrokenOff) && sweep.from.all_finite() &&
         sweep.to.all_finite() && sweep.axis_mm.all_finite() && is_valid_position(sweep.from) &&
         is_valid_position(sweep.to) && is_valid_position(sweep.axis_mm) && sweep.radius_mm > 0 &&
         sweep.radius_mm <= kMaxRadius_mm &&
         (sweep.is_of_ball() || (sweep.end_radius_mm > 0 && sweep.end_radius_mm <= kMaxRadius_mm));
}

Result<void> check_versions(const ModelVersions& now, std::span<const Cut> cuts) {
  if (now.current == nullptr || now.prepared == nullptr ||
      now.current->tissues.size() != now.prepared->tissues.size())
    return Error{ErrorKind::kBadInput, "there is no version of a model to change", "",
                 "give the current version, and the one for which its fields were made"};
  if (!std::all_of(cuts.begin(), cuts.end(), is_cut))
    return Error{ErrorKind::kBadInput, "a cut has an unknown device, a non-finite position or no radius",
                 "cuts", "give positions in the patient, and radii above 0"};
  return {};
}

}  // namespace

ModelChange current_values(const Model& model, std::size_t tissue) {
  if (tissue >= model.tissues.size()) return {model.version + 1, static_cast<std::uint32_t>(tissue)};
  return {model.version + 1, static_cast<std::uint32_t>(tissue), model.tissues[tissue]};
}

bool fields_match(const Model& current, const Model& prepared) {
  return std::equal(current.tissues.begin(), current.tissues.end(), prepared.tissues.begin(),
                    prepared.tissues.end(), [](const Tissue& a, const Tissue& b) {
                      return !a.touchable || a.stiffness_N_per_mm == b.stiffness_N_per_mm;
                    });
}

Result<std::shared_ptr<const Model>> changed_model(const Model& current, const Model& prepared,
                                                   const ModelChange& change) {
  if (change.version != current.version + 1)
    return Error{ErrorKind::kBadInput,
                 "version " + std::to_string(change.version) + " of the model does not follow version " +
                     std::to_string(current.version),
                 "", ""};
  if (change.tissue >= current.tissues.size())
    return Error{ErrorKind::kBadInput,
                 "there is no tissue " + std::to_string(change.tissue) + ": the scene has " +
                     std::to_string(current.tissues.size()),
                 "tissue", "tissues are numbered from 0, in the order of the scene"};

  auto next = std::make_shared<Model>(current);
  next->version = change.version;
  Tissue& tissue = next->tissues[change.tissue];
  static_cast<ContactProperties&>(tissue) = change.contact;
  if (auto fine = check_tissue_values(next->tissues, change.tissue); !fine) return fine.error();
  apply_to_surfaces(static_cast<int>(change.tissue), tissue, *next);
  if (fields_match(*next, prepared)) {
    next->methods = prepared.methods;
  } else {
    next->methods = {};
    if (prepared.has(ForceMethod::kTrilinear))
      next->methods[index_of(ForceMethod::kTrilinear)] = scaled_trilinear(*next, prepared);
  }

  hash_after(current, change, *next);
  return std::shared_ptr<const Model>(std::move(next));
}

bool can_compute_fields(const Model& model) {
  return model.ramp_width_mm > 0;
}

Result<std::shared_ptr<const Model>> with_rebuilt_fields(const Model& current, const Model& prepared,
                                                         const Progress& progress) {
  if (!can_compute_fields(current))
    return Error{ErrorKind::kBadInput,
                 "a union Gaussian is prepared only once, for the stiffness values of the scene", "", ""};
  auto field = with_ramp_field(current, {}, progress);
  if (!field) return field.error();
  std::shared_ptr<const Model> ready = std::move(field->model);
  for (const ForceMethodInfo& info : kDirectMethods) {
    if (!prepared.has(info.method)) continue;
    auto more = with_methods(ready, {&info.method, 1}, progress);
    if (!more && more.error().kind == ErrorKind::kInterrupted) return more.error();
    if (more) ready = *std::move(more);
  }
  return ready;
}

std::shared_ptr<const Model> with_fields(const Model& current, const Model& fields) {
  PALPATE_CHECK(fields_match(current, fields));
  auto next = std::make_shared<Model>(current);
  next->version = current.version + 1;
  next->field = fields.field;
  next->level_of_label = fields.level_of_label;
  next->methods = fields.methods;
  hash_after(current, {next->version, ModelChange::kFieldsRebuilt}, *next);
  return next;
}

std::shared_ptr<const Carving> carved_by(const Model& current, std::span<const Cut> cuts) {
  const std::shared_ptr<const Carving> before =
      current.carving != nullptr ? current.carving : std::make_shared<const Carving>(current);
  return before->with(cuts);
}

std::shared_ptr<const Carving> carved_with_fragments(const Model& current, std::vector<Cut>& cuts) {
  auto carving = carved_by(current, cuts);
  const std::vector<Cut> fragments = fragments_of(current, *carving, cuts);
  if (fragments.empty()) return carving;
  cuts.insert(cuts.end(), fragments.begin(), fragments.end());
  return carving->with(fragments);
}

ModelChange change_of_stroke(const Model& current, StrokeAction action) {
  return {current.version + 1, action == StrokeAction::kUndo ? ModelChange::kUndo : ModelChange::kRedo};
}

ModelChange change_of_law(const Model& current, TissueLaw law, double cell_factor) {
  ModelChange change{current.version + 1, ModelChange::kLaw + static_cast<std::uint32_t>(law)};
  change.contact.stiffness_N_per_mm = cell_factor;
  return change;
}

bool has_other_surfaces(const Model& current, TissueLaw law) {
  return is_elastic(law) != is_elastic(current.tissue_law);
}

Result<void> check_law(const Model& current, TissueLaw law) {
  const bool is_soft = std::ranges::any_of(
      current.tissues, [](const Tissue& tissue) { return tissue.touchable && tissue.elastic.has_value(); });
  if (!is_soft)
    return Error{ErrorKind::kBadInput, "no touchable tissue has a Young's modulus", "",
                 "give one `youngs_modulus`, or a preset that has one"};
  if (has_other_surfaces(current, law)) {
    const bool is_deformable = is_elastic(law);
    if (!current.has(ForceMethod::kProxy))
      return Error{
          ErrorKind::kBadInput,
          "soft tissue deforms only with the proxy method, and the model has no surfaces for the proxy", "",
          "set the law in the scene's [yielding], and method = \"proxy\" in [force]"};
    if (current.carving != nullptr)
      return Error{ErrorKind::kBadInput,
                   std::string("tissue was cut, and tissue that ") +
                       (is_deformable ? "deforms" : "is rendered as rigid layers") +
                       " has other surfaces, which are prepared from uncut tissue",
                   "", "start with that law, or change to it before cutting"};
  }
  if (is_moving(law) && current.carving != nullptr && !current.carving->records_fractions())
    return Error{
        ErrorKind::kBadInput,
        "the removed fraction of each voxel was not recorded, because the tissue was rigid when it was cut",
        "", "start with a law under which it moves, or change to it before cutting"};
  return {};
}

Result<std::shared_ptr<const Model>> under_law(const Model& current, TissueLaw law,
                                               const ModelPreparation& preparation,
                                               const Progress& progress) {
  if (auto fine = check_law(current, law); !fine) return fine.error();
  auto next = std::make_shared<Model>(current);
  next->tissue_law = law;
  if (!has_other_surfaces(current, law)) {
    set_strain_stiffening(*next);
    return std::shared_ptr<const Model>(std::move(next));
  }
  auto times = relaxation_times_of(current.tissues, law);
  if (!times) return times.error();
  next->relaxation_times = *times;
  return with_surfaces(std::move(next), preparation, progress);
}

std::shared_ptr<const Model> with_law(const Model& current, const Model& under, const ModelChange& change) {
  auto next = std::make_shared<Model>(under);
  next->version = change.version;
  // set by change_of_law()
  if (const double cell_factor = change.contact.stiffness_N_per_mm; cell_factor != 0)
    next->tissue_cell_factor = cell_factor;
  hash_after(current, change, *next);
  return next;
}

std::shared_ptr<const Carving> carving_after(const Carving* carving, const ModelChange& change) {
  if (carving == nullptr || !change.is_of_stroke()) return nullptr;
  return change.tissue == ModelChange::kUndo ? carving->undone() : carving->redone();
}

void apply_stroke_change(const ModelChange& change, RemovedVolume& removed) {
  if (change.tissue == ModelChange::kUndo) removed.undo();
  if (change.tissue == ModelChange::kRedo) removed.redo();
}

Result<ModelVersions> next_version(const ModelVersions& now, const ModelChange& change,
                                   std::span<const Cut> cuts, const Progress& progress,
                                   const ModelPreparation& preparation) {
  if (auto fine = check_versions(now, cuts); !fine) return fine.error();
  if (change.tissue == ModelChange::kCut) {
    if (!now.current->has(ForceMethod::kProxy))
      return Error{ErrorKind::kBadInput, "only surfaces can be cut, and this model has none", "", ""};
    return ModelVersions{carved_by(*now.current, cuts)->applied_to(*now.current), now.prepared};
  }
  if (change.is_of_stroke()) {
    const auto carving = carving_after(now.current->carving.get(), change);
    if (carving == nullptr) return Error{ErrorKind::kBadInput, "there is no stroke to undo or redo", "", ""};
    return ModelVersions{carving->applied_to(*now.current), now.prepared};
  }
  if (change.is_of_law()) {
    auto next = next_law(*now.current, change, preparation, progress);
    if (!next) return next.error();
    return ModelVersions{*std::move(next), now.prepared};
  }
  if (change.tissue != ModelChange::kFieldsRebuilt) {
    auto next_model = changed_model(*now.current, *now.prepared, change);
    if (!next_model) return next_model.error();
    return ModelVersions{*std::move(next_model), now.prepared};
  }
  const auto fields = with_rebuilt_fields(*now.current, *now.prepared, progress);
  if (!fields) return fields.error();
  const auto rebuilt = with_fields(*now.current, **fields);
  return ModelVersions{rebuilt, rebuilt};
}

}  // namespace palpate
