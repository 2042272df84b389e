#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/geometry/geometry.h"
#include "palpate/navigation/registration.h"

namespace palpate {

struct TrackedTool {};  ///< the markers of a tool that a tracker sees, a frame of its own; mm

struct PivotOptions {
  /// degrees: a motion is refused that turned some direction of the tool by less than this (root of the mean
  /// square over the poses, from their mean). Turning about one axis alone leaves that axis where it is.
  double min_turn_deg = 5;
  /// Poses that are farther off than this many times the deviation of the others are left out.
  double outlier_deviations = 3;
  int samples = 500;  ///< of poses, each taken for right, to find those that are not
  std::uint64_t seed = 1;
};

struct PivotCalibration {
  Point<TrackedTool> tip;
  Point<Tracker> pivot;              ///< where the tip stood
  std::vector<double> residuals_mm;  ///< of every pose, in their order: from its tip to the pivot
  std::vector<bool> is_outlier;      ///< those that were left out
  int used = 0;                      ///< poses
  double rms_mm = 0;                 ///< root of the mean square of the used poses' residuals
  double turn_deg = 0;               ///< see min_turn_deg
  double tip_error_mm = 0;           ///< what follows for the tip: root of its expected square
};

/// A tool's tip from poses in which it turned about its tip, which stood still: least squares of
/// R_i tip + p_i = pivot, after those poses are found that do not agree with most (least median of squares,
/// Rousseeuw, "Least median of squares regression", 1984: as many as half may be wrong).
/// @param tracker_from_tool  rigid
///
/// Errors: kBadInput for fewer than 6 poses, poses that are not rigid, and a motion too small to tell.
Result<PivotCalibration> calibrate_pivot(std::span<const Transform<Tracker, TrackedTool>> tracker_from_tool,
                                         const PivotOptions& options = {});

/// How far poses have turned the tool by now, degrees: PivotCalibration::turn_deg, before anything is left
/// out; 0 where it cannot be told. In proportion to the number of poses.
double turned_deg(std::span<const Transform<Tracker, TrackedTool>> tracker_from_tool);

}  // namespace palpate
