#include "palpate/navigation/pivot.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <optional>
#include <random>

#include "palpate/geometry/decompositions.h"

namespace palpate {
namespace {

using Pose = Transform<Tracker, TrackedTool>;
using Unknowns = Vector6d;  // coordinates of tip and pivot

struct Solution {
  Unknowns at;
  Matrix6d inverse;                    // inverse of the normal matrix
  double smallest_singular_value = 0;  // divided by the square root of the number of poses
};

// solves R_i tip - pivot = -p_i in coordinates about the mean of the poses, for good conditioning
std::optional<Solution> solve(std::span<const Pose> poses, std::span<const std::size_t> which) {
  Matrix6d normal = Matrix6d::Zero();
  Unknowns right = Unknowns::Zero();
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  for (const std::size_t n : which) centre += poses[n].translation() / static_cast<double>(which.size());
  for (const std::size_t n : which) {
    Eigen::Matrix<double, 3, 6> row;
    row << poses[n].linear(), -Eigen::Matrix3d::Identity();
    normal += row.transpose() * row;
    right -= row.transpose() * (poses[n].translation() - centre);
  }
  const SymmetricEigen<6> eigen = symmetric_eigen(normal);
  const double smallest = eigen.values[0] / static_cast<double>(which.size());
  if (!(smallest > 1e-10)) return {};
  Solution out;
  out.inverse = eigen.vectors * eigen.values.cwiseInverse().asDiagonal() * eigen.vectors.transpose();
  out.at = out.inverse * right;
  out.at.tail<3>() += centre;
  out.smallest_singular_value = std::sqrt(smallest);
  return out;
}

double residual_mm(const Pose& pose, const Unknowns& at) {
  return (pose.linear() * at.head<3>() + pose.translation() - at.tail<3>()).norm();
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

std::string degrees(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.2g degrees", value);
  return text;
}

// RMS angle, degrees, by which the poses rotate the tool's least rotated direction; 0 if the tool rotated
// about a single axis, which is that direction. solution.smallest_singular_value^2 is half of the mean
// squared angle, because the unit singular vector consists of that direction and its image, each of length
// sqrt(1/2).
double rotation_deg(const Solution& solution) {
  return solution.smallest_singular_value * std::numbers::sqrt2 * 180 / std::numbers::pi;
}

std::vector<std::size_t> places_of(std::span<const Pose> poses) {
  std::vector<std::size_t> all(poses.size());
  std::iota(all.begin(), all.end(), 0);
  return all;
}

}  // namespace

double turned_deg(std::span<const Pose> poses) {
  const auto everything = poses.empty() ? std::nullopt : solve(poses, places_of(poses));
  return everything ? rotation_deg(*everything) : 0;
}

Result<PivotCalibration> calibrate_pivot(std::span<const Pose> poses, const PivotOptions& options) {
  const auto refuse = [](std::string what, std::string remedy) {
    return Error{ErrorKind::kBadInput, std::move(what), "", std::move(remedy)};
  };
  constexpr std::size_t kMinPoses = 6, kSample = 4;
  const char* turn_more =
      "keep the tip in a dimple and tilt the tool by 30 degrees or more in all directions, and rotate it "
      "about its own axis";
  if (poses.size() < kMinPoses)
    return refuse("a pivot calibration needs " + std::to_string(kMinPoses) +
                      " poses at least, but there are " + std::to_string(poses.size()),
                  turn_more);
  for (std::size_t n = 0; n < poses.size(); ++n) {
    const Eigen::Matrix3d& r = poses[n].linear();
    if (!r.allFinite() || !poses[n].translation().allFinite() ||
        (r * r.transpose() - Eigen::Matrix3d::Identity()).norm() > 1e-2 || r.determinant() < 0)
      return refuse("pose " + std::to_string(n + 1) + " is not a rigid transform",
                    "leave it out, or check the order of its numbers");
  }

  const auto everything = solve(poses, places_of(poses));
  if (!everything || rotation_deg(*everything) < options.min_turn_deg)
    return refuse("the tool hardly turned: by " + degrees(everything ? rotation_deg(*everything) : 0) +
                      " about the axis of least rotation, but " + degrees(options.min_turn_deg) +
                      " are needed",
                  turn_more);

  // least median of squares: the minimal sample with the smallest median residual
  std::mt19937_64 random(options.seed);
  Unknowns best = everything->at;
  double min_median = 0;
  std::vector<double> residuals(poses.size());
  const auto median_by = [&](const Unknowns& at) {
    for (std::size_t n = 0; n < poses.size(); ++n) residuals[n] = residual_mm(poses[n], at);
    return median(residuals);
  };
  min_median = median_by(best);
  std::vector<std::size_t> sample(kSample);
  for (int turn = 0; turn < options.samples; ++turn) {
    for (std::size_t& each : sample) each = static_cast<std::size_t>(random() % poses.size());
    const auto solved = solve(poses, sample);
    if (!solved) continue;
    if (const double here = median_by(solved->at); here < min_median) {
      min_median = here;
      best = solved->at;
    }
  }
  // The residual is the length of three normal variables, whose median is 1.54 standard deviations, with the
  // finite-sample correction of Rousseeuw and Leroy, "Robust regression and outlier detection", 1987, eq. 1.3
  // of chapter 5. 97 % of the lengths are below three standard deviations of one direction, and all below
  // sqrt(3) times that.
  const double free = std::max<double>(1, static_cast<double>(poses.size()) - 6);
  double deviation = min_median / 1.538 * (1 + 5 / free);

  PivotCalibration out;
  std::vector<std::size_t> inliers;
  // reweighting: inliers are determined again from the solution of the inliers until they no longer change
  for (int turn = 0; turn < 20; ++turn) {
    std::vector<std::size_t> now;
    for (std::size_t n = 0; n < poses.size(); ++n)
      if (residual_mm(poses[n], best) <= options.outlier_deviations * std::numbers::sqrt3 * deviation + 1e-9)
        now.push_back(n);
    if (now.size() < kMinPoses) break;
    const bool settled = now == inliers;
    inliers = std::move(now);
    const auto solved = solve(poses, inliers);
    if (!solved || settled) break;
    best = solved->at;
    double squares = 0;
    for (const std::size_t n : inliers) squares += std::pow(residual_mm(poses[n], best), 2);
    deviation = std::sqrt(squares / (3 * static_cast<double>(inliers.size()) - 6));
  }
  const auto solved = inliers.size() < kMinPoses ? std::nullopt : solve(poses, inliers);
  if (!solved || rotation_deg(*solved) < options.min_turn_deg)
    return refuse("too few of " + std::to_string(poses.size()) + " poses agree on the position of the tip",
                  turn_more);
  out.tip = Point<TrackedTool>(solved->at.head<3>());
  out.pivot = Point<Tracker>(solved->at.tail<3>());
  out.used = static_cast<int>(inliers.size());
  out.turn_deg = rotation_deg(*solved);
  out.is_outlier.assign(poses.size(), true);
  for (const std::size_t n : inliers) out.is_outlier[n] = false;
  double squares = 0;
  for (std::size_t n = 0; n < poses.size(); ++n) {
    out.residuals_mm.push_back(residual_mm(poses[n], solved->at));
    if (!out.is_outlier[n]) squares += out.residuals_mm[n] * out.residuals_mm[n];
  }
  out.rms_mm = std::sqrt(squares / out.used);
  out.tip_error_mm =
      std::sqrt(squares / (3.0 * out.used - 6) * solved->inverse.topLeftCorner<3, 3>().trace());
  return out;
}

}  // namespace palpate
