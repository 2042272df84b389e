#pragma once

#include "palpate/contact/model.h"
#include "palpate/scene/scene.h"
#include "palpate/server/viewer_host.h"

namespace palpate {

/// Model data as published to viewers: volumes, structures, tissues, tools. Fields about devices and
/// permitted changes keep their defaults.
/// @param devices   number of devices of the session, at least one: each has its tool
/// @param declared  modality that the scene declares; if unknown, it is inferred from the scan's values
ViewedScene viewed_scene(const Model& model, std::size_t devices, Modality declared);

/// Tissue settings of a model.
std::vector<ContactProperties> viewed_tissues(const Model& model);

/// Secant stiffness of deforming tissue at the device: current force divided by current depth; N/mm. 0 at
/// zero depth.
double deformable_stiffness_N_per_mm(const DeviceTick& device);

}  // namespace palpate
