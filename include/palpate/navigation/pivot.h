#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/geometry/geometry.h"
#include "palpate/navigation/registration.h"

namespace palpate {

struct TrackedTool {};  ///< Frame of a tool's markers; mm

/// Parameters of calibrate_pivot().
struct PivotOptions {
  /// Minimum rotation of the tool, degrees. The rotation is the smallest RMS angle, over the poses and
  /// relative to their mean, by which any direction of the tool was turned. With a rotation about a single
  /// axis the tip's position along that axis is undetermined.
  double min_turn_deg = 5;
  /// Poses with a residual above this multiple of the standard deviation are excluded as outliers.
  double outlier_deviations = 3;
  int samples = 500;  ///< Number of random minimal samples of poses for outlier detection
  std::uint64_t seed = 1;
};

/// Result of calibrate_pivot().
struct PivotCalibration {
  Point<TrackedTool> tip;
  Point<Tracker> pivot;  ///< Position of the tip during the motion
  /// Distance from each pose's tip to the pivot, in the order of the poses
  std::vector<double> residuals_mm;
  std::vector<bool> is_outlier;  ///< Whether a pose was excluded
  int used = 0;                  ///< Number of poses used
  double rms_mm = 0;             ///< RMS residual of the poses used
  double turn_deg = 0;           ///< Rotation as defined at PivotOptions::min_turn_deg
  double tip_error_mm = 0;       ///< Expected RMS error of the tip
};

/// Pivot calibration: finds the tip of a tool from poses in which it rotated about its stationary tip. Least
/// squares solution of R_i tip + p_i = pivot, after the exclusion of outliers by least median of squares
/// (Rousseeuw, "Least median of squares regression", 1984; breakdown point of one half).
/// @param tracker_from_tool  rigid
///
/// Errors: kBadInput for fewer than 6 poses, poses that are not rigid, and insufficient rotation.
Result<PivotCalibration> calibrate_pivot(std::span<const Transform<Tracker, TrackedTool>> tracker_from_tool,
                                         const PivotOptions& options = {});

/// Rotation of the tool so far, degrees, as PivotCalibration::turn_deg but without the exclusion of outliers;
/// 0 if undetermined. Linear in the number of poses.
double turned_deg(std::span<const Transform<Tracker, TrackedTool>> tracker_from_tool);

}  // namespace palpate
