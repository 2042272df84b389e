#pragma once

#include <Eigen/Core>
#include <span>
#include <string>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/geometry/geometry.h"

/// Point registration of a tracked patient to the scan, with an estimate of its error. Terms as in ASTM
/// F2554: the fiducial localisation error (FLE) of a point, the fiducial registration error (FRE) that
/// remains at the points, and the target registration error (TRE) elsewhere. FRE and TRE are uncorrelated
/// (Fitzpatrick, "Fiducial registration error and target registration error are uncorrelated", SPIE 2009);
/// the error to display next to a tool is the TRE at its tip.
namespace palpate {

struct Tracker {};  ///< Frame of a tracking system; mm

/// A pair of corresponding points: in the scan, and as located by the tracker.
struct PointPair {
  std::string name;
  Point<Patient> in_scan;
  Point<Tracker> tracked;
  /// RMS error of the tracked point (all three directions combined), relative to the other pairs, mm; > 0. A
  /// point with twice the error has a quarter of the weight.
  double fle_mm = 1;
};

/// Distribution of the length of a normally distributed error.
struct ErrorSpread {
  Eigen::Matrix3d covariance_mm2 = Eigen::Matrix3d::Zero();  ///< Patient frame
  double rms_mm = 0;
  /// 95th percentile of the length, mm. The squared length is approximated by a gamma distribution with the
  /// same mean and variance, accurate to 3 %.
  double max_mm = 0;
};

/// Uncertainty of a rigid registration: covariance of a translation (first three components, mm) and a
/// rotation about a point (last three, radians), patient frame.
struct RigidError {
  Point<Patient> about;
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
};

/// Result of register_points().
struct PointRegistration {
  Transform<Patient, Tracker> patient_from_tracker;  ///< Rigid transform from tracker to patient
  std::vector<double> residuals_mm;                  ///< Residual of each pair, in their order
  double fre_mm = 0;                                 ///< Weighted RMS residual
  /// FLE of a pair with fle_mm 1 as estimated from the residuals, mm: FRE^2 = (1 - 2 / N) FLE^2, with the
  /// bounds of its 95 % confidence interval for normal errors (3 N - 6 degrees of freedom). The interval is
  /// wide for few points.
  double fle_scale = 0, min_fle_scale = 0, max_fle_scale = 0;
  Point<Patient> centroid;  ///< Weighted centroid of the points
  /// Weighted RMS distance of the points from each principal axis through the centroid, the longest axis
  /// first; mm.
  Eigen::Vector3d spread_mm = Eigen::Vector3d::Zero();
  /// Uncertainty about the centroid if the given fle_mm are the actual errors. rigid_error() scales it to the
  /// actual FLE.
  RigidError unit_error;
};

/// Limits below which points count as collinear.
struct RegistrationLimits {
  /// Minimum RMS distance of the points from a line, mm; in addition at least `min_width` times their RMS
  /// length along it. Others are rejected as collinear.
  double min_spread_mm = 2;
  double min_width = 0.05;
};

/// Weighted least squares without scale (Umeyama, "Least-squares estimation of transformation parameters
/// between two point patterns", PAMI 1991); the weight of a pair is 1 / fle_mm^2.
///
/// Errors: kBadInput for fewer than three pairs, non-finite numbers, a non-positive FLE, (nearly) collinear
/// points, and points that are a mirror image of each other (left and right, or the order of axes,
/// interchanged).
Result<PointRegistration> register_points(std::span<const PointPair> pairs,
                                          const RegistrationLimits& limits = {});

/// Uncertainty of a registration.
/// @param fle_scale  FLE of a pair with fle_mm 1, mm: known for the tracker, or PointRegistration::fle_scale
RigidError rigid_error(const PointRegistration& registration, double fle_scale);

/// TRE at a point of the patient due to the registration alone; the tracker's own error adds to it.
/// First-order propagation; for equal FLE it is eq. 46 of Fitzpatrick, West and Maurer, "Predicting error in
/// rigid-body point-based registration", TMI 1998: TRE^2(r) = FLE^2 / N (1 + 1/3 sum_k d_k^2 / f_k^2).
ErrorSpread error_at(const RigidError& error, const Point<Patient>& target);

/// Distribution of the length of a normal error with this covariance, mm^2.
ErrorSpread spread_of(const Eigen::Matrix3d& covariance_mm2);

}  // namespace palpate
