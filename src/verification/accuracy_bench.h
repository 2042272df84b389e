#pragma once

#include <string>
#include <vector>

#include "palpate/verification/verification.h"
#include "verification/accuracy_cases.h"

namespace palpate {

/// What the value should be at the first of a case's points.
using AccuracyValues = std::vector<double>;

/// What smoothing with a width makes of a shape, without voxels.
struct SmoothedTruth {
  double sigma_mm = 0;
  AccuracyValues field;          ///< a perfect Gaussian filter
  AccuracyValues smooth_sphere;  ///< the smooth sphere's own kernel
};

/// Everything that one shape is compared with, on every grid.
struct ShapeTruth {
  explicit ShapeTruth(AccuracyCase felt);

  AccuracyCase shape;
  std::vector<Eigen::Vector3d> normals;            ///< the surface's own, at its points
  std::vector<std::vector<Point<Patient>>> paths;  ///< across it, for choppiness
  SmoothedTruth wide, narrow;
  AccuracyValues profile;   ///< of the exactly sampled ramp
  AccuracyValues distance;  ///< mm
};

/// Every method's figures for one shape on a grid of that spacing; `on` ("sphere-20mm/0.3x0.3x0.3") is the
/// middle of their names. Errors: those of preparing the volumes, kInterrupted.
Result<std::vector<Figure>> measure_on_grid(const ShapeTruth& truth, const std::string& on,
                                            const Eigen::Vector3d& spacing_mm, const Progress& progress);

}  // namespace palpate
