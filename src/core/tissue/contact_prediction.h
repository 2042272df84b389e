#pragma once

#include <optional>

#include "palpate/contact/model.h"
#include "palpate/device/telemetry.h"

/// Prediction of a tool's contact with deformable tissue for the next frame of the solver.
namespace palpate {

/// Predicted contact point on a surface of the outermost layer, with the outward unit normal.
struct PredictedContact {
  Point<Patient> at;
  Vector<Patient> outward;
};

/// Contact point predicted lead_frames ahead of the tick: displaced along the surface while in contact,
/// otherwise nearest to the predicted tip. Empty if the tick is not finite or no surface is in reach.
std::optional<PredictedContact> expected_contact(const Model& model, const DeviceTick& device);
/// Depth predicted lead_frames ahead of the tick, mm; not above 0: no contact. Only the increase is limited
/// to max_lead_mm.
double expected_depth_mm(const DeviceTick& device, const PredictedContact& contact, double radius_mm);
/// Contact radius at a predicted depth d. Without contact sqrt(R d) (Hertz). In contact the radius of the
/// current force, (3 F R / (4 E*))^(1/3), times sqrt(d / current depth), but at most sqrt(R d): the
/// displacement of the surroundings is part of the depth but does not enlarge the contact.
/// @param force_N  SoftTissueSolver::displacing_force_N
double radius_at_depth_mm(const DeviceTick& device, double force_N, double depth_mm, double radius_mm,
                          double modulus_N_per_mm2);

}  // namespace palpate
