#include "palpate/navigation/registration.h"

#include <algorithm>
#include <cmath>

#include "navigation/distributions.h"
#include "palpate/geometry/decompositions.h"

namespace palpate {
namespace {

std::string millimetres(double mm) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g mm", mm);
  return text;
}

Eigen::Matrix3d cross_matrix(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

// Jacobian of a point at r from the centroid with respect to (translation, rotation)
Eigen::Matrix<double, 3, 6> moved_by(const Eigen::Vector3d& r) {
  Eigen::Matrix<double, 3, 6> moved;
  moved << Eigen::Matrix3d::Identity(), -cross_matrix(r);
  return moved;
}

}  // namespace

Result<PointRegistration> register_points(std::span<const PointPair> pairs,
                                          const RegistrationLimits& limits) {
  const auto refuse = [](std::string what, std::string remedy) {
    return Error{ErrorKind::kBadInput, std::move(what), "", std::move(remedy)};
  };
  if (pairs.size() < 3)
    return refuse(
        "a registration by points needs at least three pairs, but there are " + std::to_string(pairs.size()),
        "touch more points that are visible in the scan, four to eight of them around the target");
  double total = 0;
  Eigen::Vector3d scan_middle = Eigen::Vector3d::Zero(), tracked_middle = Eigen::Vector3d::Zero();
  for (const PointPair& pair : pairs) {
    if (!pair.in_scan.all_finite() || !pair.tracked.all_finite())
      return refuse("the coordinates of " + pair.name + " are not finite", "touch it again");
    if (!(pair.fle_mm > 0) || !std::isfinite(pair.fle_mm))
      return refuse("the error of " + pair.name + " must be above 0", "give it in millimetres");
    const double weight = 1 / (pair.fle_mm * pair.fle_mm);
    total += weight;
    scan_middle += weight * pair.in_scan.eigen();
    tracked_middle += weight * pair.tracked.eigen();
  }
  scan_middle /= total;
  tracked_middle /= total;

  Eigen::Matrix3d across = Eigen::Matrix3d::Zero(), shape = Eigen::Matrix3d::Zero(), tracked_shape = across;
  for (const PointPair& pair : pairs) {
    const double weight = 1 / (pair.fle_mm * pair.fle_mm) / total;
    const Eigen::Vector3d scan = pair.in_scan.eigen() - scan_middle,
                          seen = pair.tracked.eigen() - tracked_middle;
    across += weight * scan * seen.transpose();
    shape += weight * scan * scan.transpose();
    tracked_shape += weight * seen * seen.transpose();
  }
  // eigenvalues are ascending: the last one belongs to the longest axis
  const SymmetricEigen<3> axes = symmetric_eigen(shape), tracked_axes = symmetric_eigen(tracked_shape);
  const auto variances = [](const SymmetricEigen<3>& of) { return of.values.cwiseMax(0).eval(); };
  for (const Eigen::Vector3d& along : {variances(axes), variances(tracked_axes)}) {
    const double length = std::sqrt(along[2]), width = std::sqrt(along[0] + along[1]);
    if (width < std::max(limits.min_spread_mm, limits.min_width * length))
      return refuse("the points are nearly collinear: " + millimetres(length) + " along it, " +
                        millimetres(width) +
                        " away from it (root mean squares), so the rotation about it is undetermined",
                    "touch points that surround the target");
  }

  // Umeyama, equations 39 to 43
  const SingularVectors svd = singular_vectors(across);
  const bool mirrors = svd.u.determinant() * svd.v.determinant() < 0;
  const Eigen::Vector3d signs(1, 1, mirrors ? -1 : 1);
  const Eigen::Matrix3d rotation = svd.u * signs.asDiagonal() * svd.v.transpose();
  PointRegistration out;
  out.patient_from_tracker = {rotation, scan_middle - rotation * tracked_middle};
  out.centroid = Point<Patient>(scan_middle);
  double squares = 0, mirrored_squares = 0;
  const Eigen::Matrix3d mirrored = svd.u * svd.v.transpose();
  for (const PointPair& pair : pairs) {
    const double weight = 1 / (pair.fle_mm * pair.fle_mm) / total;
    const double away = ((out.patient_from_tracker * pair.tracked) - pair.in_scan).norm();
    out.residuals_mm.push_back(away);
    squares += weight * away * away;
    mirrored_squares +=
        weight * (mirrored * (pair.tracked.eigen() - tracked_middle) - (pair.in_scan.eigen() - scan_middle))
                     .squaredNorm();
  }
  out.fre_mm = std::sqrt(squares);
  // coplanar points fit their mirror image equally well
  if (mirrors && pairs.size() > 3 && squares > 9 * mirrored_squares && squares > 0.01 * shape.trace())
    return refuse("the points are mirror images of each other: the residual is " + millimetres(out.fre_mm) +
                      ", mirrored " + millimetres(std::sqrt(mirrored_squares)),
                  "check left and right, the order of the axes, and the order of the points");

  // the sum of squared normalised residuals, relative to a third of the squared scale, is chi-squared
  // distributed with 3 N - 6 degrees of freedom
  const double free = 3.0 * static_cast<double>(pairs.size()) - 6;
  const double by_error = squares * total;
  out.fle_scale = std::sqrt(3 * by_error / free);
  out.min_fle_scale = std::sqrt(3 * by_error / chi_squared_quantile(free, 0.975));
  out.max_fle_scale = std::sqrt(3 * by_error / chi_squared_quantile(free, 0.025));

  Matrix6d information = Matrix6d::Zero();
  for (const PointPair& pair : pairs) {
    const auto moved = moved_by(pair.in_scan.eigen() - scan_middle);
    information += 3 / (pair.fle_mm * pair.fle_mm) * moved.transpose() * moved;
  }
  out.unit_error = {out.centroid, inverse_of_symmetric(information)};
  const Eigen::Vector3d along = variances(axes).reverse();
  for (int k = 0; k < 3; ++k) out.spread_mm[k] = std::sqrt(along.sum() - along[k]);
  return out;
}

RigidError rigid_error(const PointRegistration& registration, double fle_scale) {
  return {registration.unit_error.about, fle_scale * fle_scale * registration.unit_error.covariance};
}

ErrorSpread error_at(const RigidError& error, const Point<Patient>& target) {
  const auto moved = moved_by((target - error.about).eigen());
  return spread_of(moved * error.covariance * moved.transpose());
}

ErrorSpread spread_of(const Eigen::Matrix3d& covariance_mm2) {
  ErrorSpread out;
  out.covariance_mm2 = covariance_mm2;
  const double mean = covariance_mm2.trace(), variance = 2 * covariance_mm2.squaredNorm();
  out.rms_mm = std::sqrt(mean);
  if (mean > 0) {
    // a gamma distribution is a scaled chi-squared distribution
    const double degrees = 2 * mean * mean / variance;
    out.max_mm = std::sqrt(mean / degrees * chi_squared_quantile(degrees, 0.95));
  }
  return out;
}

}  // namespace palpate
