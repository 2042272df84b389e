#pragma once

#include <Eigen/Core>
#include <span>
#include <string>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/geometry/geometry.h"

/// Where a tracked patient lies in the scan: from points that were touched and that the scan shows, and how
/// wrong what follows from them may be. Terms are those of ASTM F2554: the fiducial localisation error (FLE)
/// of a point, the fiducial registration error (FRE) that is left over at the points, the target registration
/// error (TRE) elsewhere. FRE says nothing of TRE (Fitzpatrick, "Fiducial registration error and target
/// registration error are uncorrelated", SPIE 2009): what is to be shown beside a tool is the TRE at its tip.
namespace palpate {

struct Tracker {};  ///< coordinates of a tracking system; mm

/// A point of the scan and where the tracker saw it.
struct PointPair {
  std::string name;
  Point<Patient> in_scan;
  Point<Tracker> tracked;
  /// mm, > 0: root of the mean square of how far off the tracked point is (of all three directions together),
  /// beside that of the others. A point of twice the error counts a quarter.
  double fle_mm = 1;
};

/// A squared length that is not known but by its distribution, of a normal error with this covariance.
struct ErrorSpread {
  Eigen::Matrix3d covariance_mm2 = Eigen::Matrix3d::Zero();  ///< Patient
  double rms_mm = 0;
  /// mm: 95 of 100 errors are smaller. By a gamma distribution with the mean and variance of the squared
  /// length, within 3 % of it.
  double max_mm = 0;
};

/// How wrong a registration may be: of a shift (first three numbers) and a turn about a place (radians, the
/// others), Patient.
struct RigidError {
  Point<Patient> about;
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
};

struct PointRegistration {
  Transform<Patient, Tracker> patient_from_tracker;  ///< rigid
  std::vector<double> residuals_mm;                  ///< of each pair, in their order
  double fre_mm = 0;                                 ///< root of the residuals' mean square, as they count
  /// How wrong a pair of fle_mm 1 is by what is left over, mm: FRE^2 = (1 - 2 / N) FLE^2, and the bounds
  /// within which it is in 95 of 100 cases where errors are normal (3 N - 6 of them are free). Wide where
  /// there are few points.
  double fle_scale = 0, min_fle_scale = 0, max_fle_scale = 0;
  Point<Patient> centroid;  ///< of the points, as they count
  /// mm: root of their mean square distance from each principal axis through the centroid, the longest axis
  /// first.
  Eigen::Vector3d spread_mm = Eigen::Vector3d::Zero();
  /// About the centroid, for pairs whose fle_mm is right: rigid_error() is that of pairs as wrong as they
  /// are.
  RigidError unit_error;
};

struct RegistrationLimits {
  /// mm: points whose root of the mean square distance from a line is less are refused, and so are those
  /// whose distance is less than `min_width` of their length along it.
  double min_spread_mm = 2;
  double min_width = 0.05;
};

/// Least squares without scale (Umeyama, "Least-squares estimation of transformation parameters between two
/// point patterns", PAMI 1991), each pair by 1 / fle_mm^2.
///
/// Errors: kBadInput for fewer than three pairs, numbers that are not finite, an FLE that is not positive,
/// points on one line or nearly so, and for points that are a mirror image of each other (left and right, or
/// the axes' order, is mixed up).
Result<PointRegistration> register_points(std::span<const PointPair> pairs,
                                          const RegistrationLimits& limits = {});

/// @param fle_scale  how wrong a pair of fle_mm 1 is, mm: what is known of the tracker, or the registration's
/// fle_scale
RigidError rigid_error(const PointRegistration& registration, double fle_scale);

/// What a point of the patient is wrong by, from the registration alone: the tracker's own error comes on
/// top. To first order, of Fitzpatrick, West and Maurer, "Predicting error in rigid-body point-based
/// registration", TMI 1998, eq. 46, where all errors are alike: TRE^2(r) = FLE^2 / N (1 + 1/3 sum_k d_k^2 /
/// f_k^2).
ErrorSpread error_at(const RigidError& error, const Point<Patient>& target);

/// Of normal errors with this covariance, mm^2.
ErrorSpread spread_of(const Eigen::Matrix3d& covariance_mm2);

}  // namespace palpate
