#pragma once

#include <optional>
#include <string>

#include "palpate/geometry/geometry.h"
#include "palpate/navigation/pivot.h"
#include "palpate/navigation/registration.h"

/// A tracked tool's tip in a registered patient, and how wrong the place may be at which it is shown.
namespace palpate {

/// What is known of a tool's tip.
struct ToolTip {
  Point<TrackedTool> at;
  double error_mm = 0;    ///< PivotCalibration::tip_error_mm
  double scatter_mm = 0;  ///< PivotCalibration::rms_mm: how far off one pose puts the tip
};

/// Where a tracked patient lies in the scan.
struct RegisteredPatient {
  Transform<Patient, Tracker> patient_from_tracker;  ///< rigid
  double fre_mm = 0;                                 ///< PointRegistration::fre_mm
  /// Of the registration by points; empty where nothing is known of it.
  std::optional<RigidError> error;
  /// The transform whose coordinates Tracker stands for: markers on the patient, "ReferenceToTracker"; empty:
  /// the tracking system's own, or nobody said.
  std::string reference;
};

struct Navigation {
  ToolTip tip;
  RegisteredPatient patient;
};

/// How wrong the tip's place in the scan may be (the TRE at the tip).
struct TipError {
  double rms_mm = 0;  ///< root of its mean square
  double max_mm = 0;  ///< 95 of 100 errors are smaller
  /// The tip is far outside the points that were touched: the registration alone is wrong by more than twice
  /// what it is in their middle.
  bool is_far = false;
};

/// Three errors, taken as independent of each other: the registration's at that place, the tip's in its tool,
/// and by how much one pose is off, both the same in all directions. Not in it: the error of the reference's
/// markers, and whatever is wrong with all poses alike (a distorted field, a bent tool, a patient that has
/// moved against its markers). Where the same tool has touched the points its tip's error is a part of
/// theirs, too, so that it may count twice. After a registration onto a surface it is still that of the
/// points. Empty: nothing is known of the registration's. Takes some 10 microseconds.
std::optional<TipError> error_of_tip(const Navigation& navigation, const Point<Patient>& tip);

}  // namespace palpate
