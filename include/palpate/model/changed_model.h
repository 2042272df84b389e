#pragma once

#include <memory>
#include <span>

#include "palpate/device/telemetry.h"
#include "palpate/haptics/haptics.h"
#include "palpate/model/preparing.h"
#include "palpate/tissue/carving.h"
#include "palpate/tissue/removed_volume.h"
#include "palpate/tissue/tissue_laws.h"

/// Tissues that are changed while they are felt. A version of the model follows from those before it and a
/// ModelChange alone, so that replay comes to the same.
namespace palpate {

/// The last version, and the one that the direct methods' fields were made for.
struct ModelVersions {
  std::shared_ptr<const Model> felt, made;
};
/// What a ModelChange leads to, of any kind. Errors: those below.
/// @param cuts       by which a version is cut; of the other kinds none
/// @param preparing  of surfaces, where a law needs others
Result<ModelVersions> next_version(const ModelVersions& now, const ModelChange& change,
                                   std::span<const Cut> cuts = {}, const Progress& progress = {},
                                   const Preparing& preparing = {});
/// What is taken from a model after more cuts. It is prepared for the proxy.
std::shared_ptr<const Carving> carved_by(const Model& felt, std::span<const Cut> cuts);

/// The change to a model that undoes a stroke or does one again.
ModelChange change_of_stroke(const Model& felt, StrokeAction action);

/// Soft tissue by another law, as the next version.
/// @param coarsened  Model::tissue_coarsened from then on; 0: as it is
ModelChange change_of_law(const Model& felt, TissueLaw law, double coarsened = 0);
/// Whether soft tissue can go by that law. Errors: kBadInput where no tissue that is felt has elastic
/// constants; for a law by which tissue moves after something was cut without counting parts of voxels
/// (Carving::tells_parts); and from a law by which tissue yields to one by which it does not, or back, where
/// there are no surfaces for the proxy, or something was cut from them.
Result<void> check_law(const Model& felt, TissueLaw law);
/// Whether the proxy leans on other surfaces by that law: what yields is one layer.
bool has_other_surfaces(const Model& felt, TissueLaw law);
/// A model whose soft tissue goes by that law, everything else as it was. Where the law has other surfaces
/// they are made, which takes seconds. Errors: those of check_law, relaxation that none can have, and those
/// of prepared_for; kInterrupted.
Result<std::shared_ptr<const Model>> under_law(const Model& felt, TissueLaw law,
                                               const Preparing& preparing = {},
                                               const Progress& progress = {});
/// The next version, by a change of law, where what under_law gives for it is there already.
/// @param under  of `felt`
std::shared_ptr<const Model> going_by(const Model& felt, const Model& under, const ModelChange& change);
/// What is taken from a model after a change of a stroke. Null: there is no such stroke, or the change is
/// another one. @param carving  null: nothing was cut
std::shared_ptr<const Carving> other_stroke(const Carving* carving, const ModelChange& change);

/// What a change of a stroke does to what counts as removed; other changes do nothing.
void follow(const ModelChange& change, RemovedVolume& removed);

/// The values of a tissue, as a change that leaves them as they are.
ModelChange unchanged(const Model& model, std::size_t tissue);

/// The next version, sharing everything that did not change.
///
/// The proxy reads each structure's stiffness at the tick and feels the new one at once. The direct methods
/// read fields that have every tissue's stiffness worked in, relative to the stiffest: they cannot follow.
/// While the stiffnesses are not those that the fields were made for, the version has none of them but the
/// trilinear one, which a tick has to have. That still gives what the fields were made for, and less where
/// the stiffest tissue is now softer: the most that a hand holds is reckoned from the stiffest tissue.
///
/// @param felt  the last version
/// @param made  the one that the fields were made for
/// Errors: kBadInput for a version that is not the next, a tissue that there is none of, and values that a
/// scene may not have (check_tissue_values), with the scene's key as the place.
Result<std::shared_ptr<const Model>> changed_model(const Model& felt, const Model& made,
                                                   const ModelChange& change);

/// Whether the fields of the direct methods are made for the stiffnesses that are felt.
bool fields_suit(const Model& felt, const Model& made);

/// Whether they can be made anew: inward ramps can. A union Gaussian needs the scene's files.
bool can_make_fields(const Model& model);
/// The felt model with fields for its stiffnesses and every direct method that `made` has; version and
/// content hash as they are. Takes seconds. A method that does not suit is left out. Errors: those of
/// prepare_ramps.
Result<std::shared_ptr<const Model>> with_new_fields(const Model& felt, const Model& made,
                                                     const Progress& progress = {});
/// The next version: what is felt, with fields that were made for the same stiffnesses.
std::shared_ptr<const Model> taking_fields(const Model& felt, const Model& fields);

}  // namespace palpate
