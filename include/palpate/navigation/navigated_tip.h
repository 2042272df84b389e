#pragma once

#include <optional>
#include <string>

#include "palpate/geometry/geometry.h"
#include "palpate/navigation/pivot.h"
#include "palpate/navigation/registration.h"

/// Tip of a tracked tool in a registered patient, with its uncertainty.
namespace palpate {

/// Calibrated tip of a tool.
struct ToolTip {
  Point<TrackedTool> at;
  double error_mm = 0;    ///< PivotCalibration::tip_error_mm
  double scatter_mm = 0;  ///< PivotCalibration::rms_mm: scatter of the tip position of a single pose
};

/// Registration of a tracked patient to the scan.
struct RegisteredPatient {
  Transform<Patient, Tracker> patient_from_tracker;  ///< Rigid transform from tracker to patient
  double fre_mm = 0;                                 ///< PointRegistration::fre_mm
  /// Uncertainty of the point registration; empty: unknown.
  std::optional<RigidError> error;
  /// Name of the transform that defines the Tracker frame, e.g. markers on the patient
  /// ("ReferenceToTracker"). Empty: the tracking system's own frame, or not stated.
  std::string reference;
};

/// Calibrated tool and registered patient.
struct Navigation {
  ToolTip tip;
  RegisteredPatient patient;
};

/// Uncertainty of the tip's position in the scan (target registration error, TRE, at the tip).
struct TipError {
  double rms_mm = 0;  ///< RMS error
  double max_mm = 0;  ///< 95th percentile of the error
  /// Whether the tip is far outside the registration points, i.e. the registration error at the tip is more
  /// than twice the one at their centroid.
  bool is_far = false;
};

/// Combines three errors that are assumed to be independent: the registration error at that point, the
/// calibration error of the tip, and the scatter of a single pose; the latter two are isotropic. Not
/// included: the error of the reference markers, and systematic errors of all poses (a distorted field, a
/// bent tool, a patient that moved relative to the markers). If the registration points were touched with the
/// same tool, its tip error may be counted twice. After a registration to a surface the error is still that
/// of the point registration. Empty if the registration error is unknown. Takes some 10 microseconds.
std::optional<TipError> error_of_tip(const Navigation& navigation, const Point<Patient>& tip);

}  // namespace palpate
