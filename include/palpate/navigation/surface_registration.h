#pragma once

#include <span>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"
#include "palpate/geometry/geometry.h"
#include "palpate/navigation/registration.h"
#include "palpate/sampling/surface.h"

namespace palpate {

struct SurfaceRegistrationOptions {
  /// mm: of the ball by which the surface was touched; its middle was tracked.
  double tip_radius_mm = 0;
  /// Of the points, 0 ... 0.5: those that fit worst count nothing, e.g. where the tool had left the surface.
  double trimmed = 0.1;
  /// mm: a fit that leaves more (root mean square of those that count) is refused.
  double max_rms_mm = 1;
  /// And so is one by which more than this share of all points is farther away than `far_mm`: a few that fit
  /// nowhere are a hand that slipped, more are another structure, or its mirror image, most of which lies
  /// within a millimetre.
  double max_far = 0.05;
  double far_mm = 5;
  /// A shift or turn that the points do not hold is refused: where the least eigenvalue of what they hold is
  /// below this, of 1 for a point that holds it wholly (a turn by what it moves at their root mean square
  /// distance).
  double min_hold = 0.005;
};

struct SurfaceRegistration {
  Transform<Patient, Tracker> patient_from_tracker;  ///< rigid
  std::vector<double> distances_mm;  ///< of every point, in their order: from the surface, outside positive
  std::vector<bool> is_trimmed;
  double rms_mm = 0;                    ///< of those that count
  double moved_mm = 0, turned_deg = 0;  ///< away from where it began, at the points' centroid
  double hold = 0;                      ///< see min_hold
};

/// Brings points that were touched on a structure onto its surface: point to plane (Chen and Medioni, "Object
/// modelling by registration of multiple range images", Image and Vision Computing 10, 1992), trimmed
/// (Chetverikov, Stepanov and Krsek, "Robust Euclidean alignment of 3D point sets", 2005), first against the
/// surface's nearest places, then against its distance field itself. Begun from `start` and from 12 places
/// around it (10 mm along each axis, 10 degrees about each), of which the best counts.
///
/// Errors: kBadInput for fewer than 12 points, points that are not finite, a surface without a place, points
/// that leave some shift or turn open (all on a plane or a ball), and a fit that leaves more than
/// max_rms_mm: another structure, the other side, or a start too far away; kInterrupted.
Result<SurfaceRegistration> register_to_surface(const Surface& surface,
                                                std::span<const Point<Tracker>> touched,
                                                const Transform<Patient, Tracker>& start,
                                                const SurfaceRegistrationOptions& options = {},
                                                const Progress& progress = {});

}  // namespace palpate
