#pragma once

#include <span>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"
#include "palpate/geometry/geometry.h"
#include "palpate/navigation/registration.h"
#include "palpate/sampling/surface.h"

namespace palpate {

/// Parameters of register_to_surface().
struct SurfaceRegistrationOptions {
  /// Radius of the ball tip that touched the surface, mm; its centre is tracked.
  double tip_radius_mm = 0;
  /// Fraction of the points, 0 ... 0.5, with the largest residuals that is trimmed, e.g. where the tool had
  /// left the surface.
  double trimmed = 0.1;
  /// Maximum RMS residual of the untrimmed points, mm.
  double max_rms_mm = 1;
  /// Maximum fraction of all points with a residual above `far_mm`. A few such points are slips of the hand;
  /// more indicate another structure, or a mirror image, for which most residuals are below a millimetre.
  double max_far = 0.05;
  double far_mm = 5;
  /// Minimum eigenvalue of the normalised information matrix; below it some translation or rotation is
  /// unconstrained by the points. 1: constrained by every point (rotations are scaled by the points' RMS
  /// distance).
  double min_hold = 0.005;
};

/// Result of register_to_surface().
struct SurfaceRegistration {
  Transform<Patient, Tracker> patient_from_tracker;  ///< Rigid transform from tracker to patient
  /// Signed distance of each point from the surface, in their order; positive outside
  std::vector<double> distances_mm;
  std::vector<bool> is_trimmed;
  double rms_mm = 0;  ///< RMS residual of the untrimmed points
  /// Displacement and rotation relative to `start`, at the points' centroid
  double moved_mm = 0, turned_deg = 0;
  double hold = 0;  ///< Eigenvalue as defined at SurfaceRegistrationOptions::min_hold
};

/// Registers points that were touched on a structure to its surface by ICP: point-to-plane (Chen and Medioni,
/// "Object modelling by registration of multiple range images", Image and Vision Computing 10, 1992), trimmed
/// (Chetverikov, Stepanov and Krsek, "Robust Euclidean alignment of 3D point sets", 2005), first against the
/// nearest points of the surface, then against its distance field. Started from `start` and from 12
/// perturbations of it (10 mm along each axis, 10 degrees about each); the best result is returned.
///
/// Errors: kBadInput for fewer than 12 points, non-finite points, an empty surface, points that leave a
/// translation or rotation unconstrained (all on a plane or a sphere), and residuals above the limits
/// (another structure, the opposite side, or a start too far away); kInterrupted.
Result<SurfaceRegistration> register_to_surface(const Surface& surface,
                                                std::span<const Point<Tracker>> touched,
                                                const Transform<Patient, Tracker>& start,
                                                const SurfaceRegistrationOptions& options = {},
                                                const Progress& progress = {});

}  // namespace palpate
