#pragma once

#include <memory>
#include <span>
#include <vector>

#include "palpate/contact/model.h"
#include "palpate/device/model_change.h"
#include "palpate/model/model_preparation.h"
#include "palpate/tissue/carving.h"
#include "palpate/tissue/removed_volume.h"
#include "palpate/tissue/tissue_laws.h"

/// Changes to tissues while they are in contact. A version of the model is determined by the versions before
/// it and a ModelChange alone, so that replay reproduces it.
namespace palpate {

/// The current version, and the version for which the direct methods' fields were computed.
struct ModelVersions {
  std::shared_ptr<const Model> current, prepared;
};
/// Versions after a ModelChange of any kind. Errors: those of the functions below; kBadInput without a
/// current version, and for a cut with an unknown device, a radius that is not positive, or a non-finite
/// position.
/// @param cuts         cuts to apply; used by kCut only
/// @param preparation  computes surfaces if a law requires other ones
Result<ModelVersions> next_version(const ModelVersions& now, const ModelChange& change,
                                   std::span<const Cut> cuts = {}, const Progress& progress = {},
                                   const ModelPreparation& preparation = {});
/// Carving of a model after more cuts. The model must be prepared for the proxy.
std::shared_ptr<const Carving> carved_by(const Model& current, std::span<const Cut> cuts);
/// The same, without the fragments that the cuts sever from the body (palpate/tissue/fragments.h). Appends
/// the cuts that remove these: the version is the one of carved_by() after all of them.
std::shared_ptr<const Carving> carved_with_fragments(const Model& current, std::vector<Cut>& cuts);

/// Change that undoes or redoes a stroke.
ModelChange change_of_stroke(const Model& current, StrokeAction action);

/// Change that selects another constitutive law for soft tissue, as the next version.
/// @param cell_factor  new Model::tissue_cell_factor; 0: unchanged
ModelChange change_of_law(const Model& current, TissueLaw law, double cell_factor = 0);
/// Whether soft tissue can use a law. Errors: kBadInput if no touchable tissue has elastic constants; for a
/// law under which tissue moves, if material was cut without recording fractions of voxels
/// (Carving::records_fractions); for a change between a law with deformable contact and one without, if there
/// are no surfaces for the proxy or something was cut from them.
Result<void> check_law(const Model& current, TissueLaw law);
/// Whether the proxy uses other surfaces under a law: deformable tissues form a single layer.
bool has_other_surfaces(const Model& current, TissueLaw law);
/// Model whose soft tissue uses a law, otherwise unchanged. If the law requires other surfaces they are
/// computed, which takes seconds. Errors: those of check_law and prepared_for; kBadInput for an invalid
/// relaxation; kInterrupted.
Result<std::shared_ptr<const Model>> under_law(const Model& current, TissueLaw law,
                                               const ModelPreparation& preparation = {},
                                               const Progress& progress = {});
/// Next version after a change of law, using a model from under_law() instead of computing it.
/// @param under  under_law() of `current`
std::shared_ptr<const Model> with_law(const Model& current, const Model& under, const ModelChange& change);
/// Carving after a change that undoes or redoes a stroke. Null if there is no such stroke, or for other
/// changes.
/// @param carving  current carving; null: nothing was cut
std::shared_ptr<const Carving> carving_after(const Carving* carving, const ModelChange& change);

/// Applies the undo or redo of a stroke to the removed volume; other changes have no effect.
void apply_stroke_change(const ModelChange& change, RemovedVolume& removed);

/// Change with a tissue's current values, which leaves them as they are. next_version() refuses the change of
/// a tissue that the model does not have.
ModelChange current_values(const Model& model, std::size_t tissue);

/// Next version after a change of a tissue's values. Shares all unchanged data.
///
/// The proxy reads each structure's stiffness in the tick and uses the new value at once. The direct methods
/// read fields that contain every tissue's stiffness relative to the stiffest one and cannot follow. While
/// the stiffnesses differ from those of the fields, the version has no direct method but the trilinear one,
/// which a tick requires. It renders the stiffnesses of the fields, scaled down if the stiffest tissue is now
/// softer, because the limit of what an operator can hold is derived from the stiffest tissue.
///
/// @param current   the current version
/// @param prepared  the version for which the fields were computed
/// Errors: kBadInput for a version that is not the next, a tissue index out of range, or values outside the
/// scene's ranges (check_tissue_values), with the scene's key as location.
Result<std::shared_ptr<const Model>> changed_model(const Model& current, const Model& prepared,
                                                   const ModelChange& change);

/// Whether the direct methods' fields match the current stiffnesses.
bool fields_match(const Model& current, const Model& prepared);

/// Whether the fields can be recomputed: inward ramps can; a union Gaussian needs the scene's files.
bool can_compute_fields(const Model& model);
/// The current model with fields for its stiffnesses and every direct method of `prepared`; version and
/// content hash are unchanged. Takes seconds. Methods that cannot be prepared are omitted. Errors: those of
/// prepare_ramps.
Result<std::shared_ptr<const Model>> with_rebuilt_fields(const Model& current, const Model& prepared,
                                                         const Progress& progress = {});
/// Next version of `current` with the fields of `fields`, which must have the same stiffnesses.
std::shared_ptr<const Model> with_fields(const Model& current, const Model& fields);

}  // namespace palpate
