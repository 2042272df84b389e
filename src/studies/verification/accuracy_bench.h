#pragma once

#include <string>
#include <vector>

#include "palpate/verification/verification.h"
#include "verification/accuracy_cases.h"

namespace palpate {

/// Exact values at the first of a case's points.
using AccuracyValues = std::vector<double>;

/// Exact values of a shape smoothed with a given width, without voxels.
struct SmoothedTruth {
  double sigma_mm = 0;
  AccuracyValues field;          ///< By an ideal Gaussian filter
  AccuracyValues smooth_sphere;  ///< By the kernel of the smooth sphere
};

/// Reference values of one shape, for all grids.
struct ShapeTruth {
  explicit ShapeTruth(AccuracyCase accuracy_case);

  AccuracyCase shape;
  std::vector<Eigen::Vector3d> normals;            ///< Exact surface normals at the points
  std::vector<std::vector<Point<Patient>>> paths;  ///< Paths on the surface, for choppiness
  SmoothedTruth wide, narrow;
  AccuracyValues profile;   ///< For the exactly sampled ramp
  AccuracyValues distance;  ///< Signed distance, mm
};

/// Figures of every method for one shape on a grid of that spacing. `on` ("sphere-20mm/0.3x0.3x0.3") is the
/// middle part of their names. Errors: those of preparing the volumes, kInterrupted.
Result<std::vector<Figure>> measure_on_grid(const ShapeTruth& truth, const std::string& on,
                                            const Eigen::Vector3d& spacing_mm, const Progress& progress);

}  // namespace palpate
