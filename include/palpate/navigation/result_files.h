#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/navigation/navigated_tip.h"
#include "palpate/navigation/surface_registration.h"

/// Files written by `palpate pivot` and `palpate register` (JSON, docs/guide/navigation.md), and their
/// parsers. Lengths are in mm, points of the scan in LPS.
namespace palpate {

/// Serialises a calibration for `palpate pivot`.
std::string tip_text(const PivotCalibration& found);

/// Parses the tip from a calibration file. Errors: kBadInput for another kind of file.
/// @param where  name of the file, for errors
Result<ToolTip> parse_tip(std::string_view text, const std::string& where);

/// Complete result of a registration.
struct RegistrationOutcome {
  PointRegistration by_points;
  std::vector<std::string> names;  ///< Names of the points, in their order
  /// For points touched live: scatter of the tip while it was held (TouchedPoint). Empty: the points came
  /// from a file.
  std::vector<double> spread_mm;
  bool is_fle_known = false;  ///< Whether the FLE was given instead of estimated from the residuals
  /// Argument of rigid_error; empty: unknown, because the residuals are exactly zero.
  std::optional<double> fle_scale;
  std::vector<Point<Patient>> targets;  ///< Points at which the TRE is reported
  std::string reference;                ///< Reference transform, as RegisteredPatient::reference
  struct OnSurface {
    std::string structure;
    SurfaceRegistration found;
  };
  std::optional<OnSurface> surface;

  /// The transform of the surface registration if present, otherwise of the point registration.
  const Transform<Patient, Tracker>& patient_from_tracker() const {
    return surface ? surface->found.patient_from_tracker : by_points.patient_from_tracker;
  }
};
/// Serialises a registration for `palpate register`.
std::string registration_text(const RegistrationOutcome& outcome);

/// Parses a registration file. Errors: kBadInput for another kind of file.
/// @param where  name of the file, for errors
Result<RegisteredPatient> parse_registration(std::string_view text, const std::string& where);

}  // namespace palpate
