#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <span>

#include "palpate/base/force_method.h"
#include "palpate/base/progress.h"
#include "palpate/base/result.h"
#include "palpate/contact/contact_site.h"
#include "palpate/contact/model.h"
#include "palpate/contact/tool_contact.h"
#include "palpate/direct/force_field.h"

/// The direct force methods: the force follows from a field at the tip, without a proxy
/// (docs/concepts/methods.md). Only the tick, the preparation of models and the rendering of these fields
/// depend on this module; the proxy does not.
namespace palpate {

/// Prepares the force field of one direct method. The model must have field, labels, levels, tissues and
/// settings (with_direct_methods() in palpate/model/make_model.h adds a missing field). Every method has the
/// stiffness of the stiffest tissue at a flat surface of that tissue; the slope of the force elsewhere
/// depends on the method's own filter width (docs/concepts/methods.md). Errors: kBadInput if the radius of a
/// sphere method does not suit the voxel size.
Result<std::shared_ptr<const ForceField>> make_force_field(const Model& model, ForceMethod method);

/// Performs the checks of make_force_field() without computing the field. Errors: those of
/// make_force_field().
Result<void> check_force_field(const Model& model, ForceMethod method);
/// Upper bound of the memory make_force_field() needs besides the model; bytes.
std::uint64_t memory_of_force_field(const Model& model, ForceMethod method);

/// The model with additional direct methods prepared; the same pointer if they already are. The model must
/// have its field. Version and content hash stay. Errors: those of make_force_field(), kInterrupted.
Result<std::shared_ptr<const Model>> with_methods(std::shared_ptr<const Model> model,
                                                  std::span<const ForceMethod> methods,
                                                  const Progress& progress = {});

/// Finds the structure in contact: the first touchable label along the inward normal within Model::reach_mm,
/// sampled every half voxel. If there is none (in a valley between structures, or deep inside where the field
/// has no direction), the nearest one along 14 directions. The surface is the same for every force method:
/// for smoothed labels where the field is midway between the label's level and that of the touchable label
/// covering it or free space; for ramps the boundary of the label's voxels. Bounded: at most a few hundred
/// voxel look-ups.
/// @param sample  sample of the force method at x; its gradient gives the normal
ContactSite find_contact_site(const Model& model, const Point<Patient>& x, const FieldSample& sample);

/// Published pseudo-friction: a viscous force tangential to the surface, limited to the tissue's maximum and
/// to mu |F_n|; N.
/// @param max_N_s_per_mm  limit of the damping coefficient
Vector<Patient> pseudo_friction(const Tissue& tissue, const Vector<Patient>& velocity_mm_s,
                                const Vector<Patient>& normal_force_N,
                                double max_N_s_per_mm = std::numeric_limits<double>::infinity());

/// Contact by a direct force method: sum over the tool's points.
/// @param tick     inputs common to all devices
/// @param context  inputs of this device
ToolContact touch_directly(const TickContext& tick, const DeviceContext& context);

}  // namespace palpate
