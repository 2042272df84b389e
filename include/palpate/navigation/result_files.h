#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/navigation/navigated_tip.h"
#include "palpate/navigation/surface_registration.h"

/// The files that `palpate pivot` and `palpate register` write (JSON, docs/guide/navigation.md), and what is
/// read of them again. Lengths are mm, places of the scan LPS.
namespace palpate {

std::string tip_text(const PivotCalibration& found);

/// Errors: kBadInput for what is no tip's file. @param where  the file's name, for errors
Result<ToolTip> parse_tip(std::string_view text, const std::string& where);

/// All that came of a registration.
struct RegistrationOutcome {
  PointRegistration by_points;
  std::vector<std::string> names;  ///< of the points, in their order
  /// Of points that were touched live: how still the tip was held (HeldPlace). Empty: they came from a file.
  std::vector<double> held_mm;
  bool is_fle_known = false;  ///< it was given, and not estimated from what is left over
  /// As rigid_error takes it; empty: the points fit without any error, and nothing is known.
  std::optional<double> fle_scale;
  std::vector<Point<Patient>> targets;  ///< where the error is told
  std::string reference;                ///< RegisteredPatient::reference
  struct OnSurface {
    std::string structure;
    SurfaceRegistration found;
  };
  std::optional<OnSurface> surface;

  /// The surface's, where there is one.
  const Transform<Patient, Tracker>& patient_from_tracker() const {
    return surface ? surface->found.patient_from_tracker : by_points.patient_from_tracker;
  }
};
std::string registration_text(const RegistrationOutcome& outcome);

/// Errors: kBadInput for what is no registration's file. @param where  the file's name, for errors
Result<RegisteredPatient> parse_registration(std::string_view text, const std::string& where);

}  // namespace palpate
