#include "server/redacted_contact.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "server/viewed_vectors.h"

namespace palpate::server {
namespace {

/// Isovalue of the interpolated solidity at which a surface lies.
constexpr double kSurface = 0.5;
/// Search limit: deeper than any tool presses in.
constexpr double kMaxDepth_mm = 15;
/// Threshold below which a force has no reliable direction.
constexpr double kMin_N = 1e-6;

Eigen::Matrix3d rotation_of(const std::array<double, 4>& wxyz) {
  const Eigen::Quaterniond q(wxyz[0], wxyz[1], wxyz[2], wxyz[3]);
  return (q.norm() > 0 ? q.normalized() : Eigen::Quaterniond::Identity()).toRotationMatrix();
}

/// Sphere of a tool's outline, in the tip's frame.
struct Ball {
  Eigen::Vector3d centre_mm;
  double radius_mm;
};

std::vector<Ball> balls_of(const ViewedTool& tool) {
  std::vector<Ball> balls;
  for (const auto& point : tool.points_mm) balls.push_back({vector_of(point), tool.radius_mm});
  constexpr int kBetween = 4;
  for (const ViewedTool::Capsule& capsule : tool.capsules)
    for (int n = 0; n <= kBetween; ++n) {
      const double along = static_cast<double>(n) / kBetween;
      const Eigen::Vector3d from = vector_of(capsule.from_mm), to = vector_of(capsule.to_mm);
      balls.push_back({from + along * (to - from),
                       capsule.radius_mm + along * (capsule.end_radius_mm - capsule.radius_mm)});
    }
  return balls;
}

}  // namespace

RedactedContact::RedactedContact(const ViewedScene& scene)
    : scene_(scene),
      X_VoxelPatient_(scene.labels->geometry().X_PatientVoxel().inverse()),
      is_touchable_(std::size_t{std::numeric_limits<LabelId>::max()} + 1),
      step_mm_(0.5 * scene.labels->geometry().min_spacing_mm()) {
  for (std::size_t row = 0; row < 3; ++row)
    for (std::size_t column = 0; column < 3; ++column)
      R_WorldPatient_(static_cast<int>(row), static_cast<int>(column)) =
          scene.world_from_patient[row][column];
  for (const ViewedStructure& structure : scene.structures)
    is_touchable_[structure.label] = structure.label != 0 && structure.tissue >= 0 &&
                                     scene.tissues[static_cast<std::size_t>(structure.tissue)].touchable;
}

// trilinear interpolation of the solid voxels
double RedactedContact::solid_at(const Eigen::Vector3d& position_mm) const {
  const Eigen::Vector3d voxel = (X_VoxelPatient_ * Point<Patient>(position_mm)).eigen();
  const Eigen::Vector3d low = voxel.array().floor(), part = voxel - low;
  const GridGeometry& grid = scene_.labels->geometry();
  for (int axis = 0; axis < 3; ++axis)
    if (!(low[axis] >= -1 && low[axis] <= grid.dims[static_cast<std::size_t>(axis)])) return 0;
  double solid = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const Eigen::Vector3i side(corner & 1, corner >> 1 & 1, corner >> 2);
    const Eigen::Vector3i at = low.cast<int>() + side;
    if (!is_touchable_[scene_.labels->anywhere(at[0], at[1], at[2])]) continue;
    double weight = 1;
    for (int axis = 0; axis < 3; ++axis) weight *= side[axis] != 0 ? part[axis] : 1 - part[axis];
    solid += weight;
  }
  return solid;
}

// nearest voxel in contact among the eight around a place; 0: none
LabelId RedactedContact::nearest_touchable(const Eigen::Vector3d& position_mm) const {
  const Eigen::Vector3d voxel = (X_VoxelPatient_ * Point<Patient>(position_mm)).eigen();
  const Eigen::Vector3d low = voxel.array().floor();
  const GridGeometry& grid = scene_.labels->geometry();
  for (int axis = 0; axis < 3; ++axis)
    if (!(low[axis] >= -1 && low[axis] <= grid.dims[static_cast<std::size_t>(axis)])) return 0;
  double nearest = std::numeric_limits<double>::infinity();
  LabelId found = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const Eigen::Vector3d at = low + Eigen::Vector3d(corner & 1, corner >> 1 & 1, corner >> 2);
    const LabelId label =
        scene_.labels->anywhere(static_cast<int>(at[0]), static_cast<int>(at[1]), static_cast<int>(at[2]));
    const double separation = (at - voxel).squaredNorm();
    if (!is_touchable_[label] || separation >= nearest) continue;
    nearest = separation;
    found = label;
  }
  return found;
}

// distance to the surface along `outward`; 0 if it starts outside
double RedactedContact::exit_distance_mm(const Eigen::Vector3d& from_mm,
                                         const Eigen::Vector3d& outward) const {
  double before = solid_at(from_mm);
  if (before < kSurface) return 0;
  for (double distance_mm = step_mm_; distance_mm <= kMaxDepth_mm; distance_mm += step_mm_) {
    const double now = solid_at(from_mm + distance_mm * outward);
    if (now < kSurface) return distance_mm - step_mm_ * (kSurface - now) / (before - now);
    before = now;
  }
  return kMaxDepth_mm;
}

RedactedContact::Touch RedactedContact::of(const TickRecord& tick, std::size_t number) const {
  const DeviceTick& device = tick.device[number];
  const Eigen::Vector3d tip = vector_of(device.tip_patient_mm);
  Touch touch{tip, Eigen::Vector3d::Zero()};
  const Eigen::Vector3d force_N = vector_of(device.force_N);
  if (!tip.allFinite() || !force_N.allFinite() || force_N.norm() < kMin_N || scene_.tools.empty())
    return touch;
  const Eigen::Matrix3d R_PatientWorld =
      (rotation_of(tick.rotation_applied_wxyz) * R_WorldPatient_).transpose();
  const Eigen::Matrix3d R_PatientTool = R_PatientWorld * rotation_of(device.orientation_wxyz);
  const Eigen::Vector3d outward = (R_PatientWorld * force_N).normalized();

  // the deepest sphere of the tool, and its penetration along the force
  Eigen::Vector3d deepest = tip;
  double depth_mm = 0;
  LabelId label = 0;
  for (const Ball& ball : balls_of(scene_.tools[std::min(number, scene_.tools.size() - 1)])) {
    const Eigen::Vector3d position = tip + R_PatientTool * ball.centre_mm - ball.radius_mm * outward;
    const double distance_mm = exit_distance_mm(position, outward);
    if (distance_mm > depth_mm) {
      depth_mm = distance_mm;
      deepest = position;
    } else if (depth_mm == 0 && label == 0) {
      // a tool in marginal contact lies outside the voxels, on their smoothed surface
      label = nearest_touchable(position - step_mm_ * outward);
    }
  }
  if (depth_mm > 0) label = nearest_touchable(deepest + (depth_mm - step_mm_) * outward);
  if (label == 0) return touch;
  return {tip + depth_mm * outward, outward, depth_mm, label};
}

}  // namespace palpate::server
