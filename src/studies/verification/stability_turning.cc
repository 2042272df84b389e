#include "verification/stability_turning.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "palpate/contact/proxy_path.h"
#include "palpate/surfaces/surfaces.h"
#include "verification/accuracy_random.h"

namespace palpate {
namespace {

constexpr double kHalfPlate_mm = 1, kPlateRadius_mm = 14, kHalfGrid_mm = 19;
constexpr double kMaxTurn_rad_s = 20, kMaxLever_mm = 100;
constexpr double kDetectedTurn_N = 0.5, kSampled_mm = 0.02;
// a thinner shaft penetrates more between two spheres of its row
constexpr double kMinShaft_mm = 0.3, kSampledShaft_mm = 0.1, kAlong_mm = 0.25, kShaftDip_mm = 0.01;
constexpr int kTurnsOfAPlate = 50, kTicksAtRest = 60;
const Eigen::Vector3d kPlateVoxels_mm[] = {{0.36, 0.36, 0.7}, {0.28, 0.28, 1.0}, {0.625, 0.625, 0.9}};

/// A round plate of labels at a random position relative to the voxels.
struct RoundPlate {
  ContactSurface contact;
  Eigen::Vector3d normal, middle;
};

Result<RoundPlate> round_plate(const Eigen::Vector3d& spacing_mm, AccuracyRandom& random) {
  RoundPlate plate;
  plate.normal = random.direction();
  plate.middle = random.direction() * random.between(0, 1);
  GridGeometry grid;
  for (int axis = 0; axis < 3; ++axis)
    grid.dims[static_cast<std::size_t>(axis)] = static_cast<int>(2 * kHalfGrid_mm / spacing_mm[axis]) + 1;
  grid.spacing_mm = spacing_mm;
  grid.origin = Point<Patient>(-kHalfGrid_mm, -kHalfGrid_mm, -kHalfGrid_mm);
  Volume<LabelId> labels(grid);
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) {
        const Eigen::Vector3d p = (X_PatientVoxel * Point<Voxel>(i, j, k)).eigen() - plate.middle;
        const double across_mm = plate.normal.dot(p);
        const double lateral_mm = (p - plate.normal * across_mm).norm();
        if (std::abs(across_mm) <= kHalfPlate_mm && lateral_mm <= kPlateRadius_mm) labels.at(i, j, k) = 1;
      }
  const auto prepared = prepare_surfaces(*label_bricks(labels), {1}, {});
  if (!prepared) return prepared.error();
  plate.contact.surface = std::make_shared<const Surface>(prepared->front().surface);
  plate.contact.set_friction(0);
  return plate;
}

struct TurnedLever {
  bool detected = false, through = false, shaft = false;
  double deepest_mm = 0;  ///< Maximum over its whole path
};

/// A hand that rotates a tool about its tip so that the end of the lever passes through the plate and stops
/// on the other side.
class TurningHand {
 public:
  TurningHand(const RoundPlate& plate, AccuracyRandom& random) : plate_(plate), random_(random) {
    // the end moves against the normal, obliquely, near the centre of the plate
    constexpr double kMinAhead = 0.6;
    Eigen::Vector3d tangent = random.direction();
    while (-tangent.dot(plate.normal) < kMinAhead) tangent = random.direction();
    lever_ = tangent.cross(random.direction()).normalized() * random.between(25, kMaxLever_mm);
    // starts on the side of the plate on which the tip is
    if (lever_.dot(plate.normal) > 0) lever_ = -lever_;
    axis_ = lever_.cross(tangent).normalized();
    tip_ = Point<Patient>(plate.middle - lever_);

    // sphere at the end, sphere or shaft at the tip, and up to two more spheres; some of them are points
    const double radius_mm = std::max(0.0, random.between(-0.6, 1.5));
    tool_ = {{Vector<Patient>(lever_), radius_mm}, {{}, radius_mm}};
    if (random.between(0, 1) < 0.5) tool_.push_back({Vector<Patient>(lever_ * 0.95), radius_mm});
    if (random.between(0, 1) < 0.5)
      tool_.push_back({Vector<Patient>(lever_ + random.direction() * 2), radius_mm});
    // half of them have a shaft between tip and end
    if (random.between(0, 1) < 0.5)
      tool_[1] = {{}, std::max(kMinShaft_mm, radius_mm), Vector<Patient>(lever_)};

    // from the angle at which the whole tool is free to that at which the end has passed through
    constexpr double kFree_mm = 0.5, kBehind_mm = 2.5, kBack_rad = 0.01;
    end_rad_ = (kHalfPlate_mm + radius_mm + kBehind_mm) / -tangent.dot(plate.normal) / lever_.norm();
    begin_rad_ = -end_rad_;
    while (clearance_mm(tip_, turn_of(begin_rad_)) < kFree_mm) begin_rad_ -= kBack_rad;
    speed_rad_s_ = random.between(0.1, 1) * kMaxTurn_rad_s;
    tick_s_ = random.between(0, 1) < 0.5 ? 1e-3 : 4e-3;
    jitter_ = random.between(0, 1) < 0.5 ? 0 : 0.5;
  }

  TurnedLever run() {
    double angle = begin_rad_;
    follow(angle);
    while (angle < end_rad_) {
      angle = std::min(end_rad_, angle + speed_rad_s_ * tick_s_ * random_.between(1 - jitter_, 1 + jitter_));
      follow(angle);
    }
    for (int n = 0; n < kTicksAtRest; ++n) follow(end_rad_);
    const Eigen::Vector3d end = state_.position.eigen() + state_.attitude * lever_;
    turned_.through = plate_.normal.dot(end - plate_.middle) < 0;
    turned_.shaft = has_shaft();
    return turned_;
  }

 private:
  RotatedTool tool_at(const Eigen::Quaterniond& attitude) const {
    return {tool_, Eigen::Quaterniond::Identity(), attitude};
  }

  Eigen::Quaterniond turn_of(double angle_rad) const {
    return Eigen::Quaterniond(Eigen::AngleAxisd(angle_rad, axis_));
  }
  double clearance_mm(const Point<Patient>& at, const Eigen::Quaterniond& attitude) const {
    double min_mm = std::numeric_limits<double>::infinity();
    const RotatedTool tool = tool_at(attitude);
    for (const ToolPart& part : tool.parts()) {
      // evaluates the outline of a shaft, not the row of spheres that represents it
      const int count = static_cast<int>(part.axis_mm.norm() / kAlong_mm);
      for (int index = 0; index <= count; ++index) {
        const Vector<Patient> along_mm = part.axis_mm * (static_cast<double>(index) / std::max(1, count));
        const double distance_mm = plate_.contact.surface->distance_mm(at + part.offset_mm + along_mm);
        min_mm = std::min(min_mm, distance_mm - part.radius_mm);
      }
    }
    return min_mm;
  }

  bool has_shaft() const { return tool_[1].axis_mm != Vector<Patient>(); }

  void follow(double angle_rad) {
    const ToolPose hand(tip_, turn_of(angle_rad));
    const ToolPose before(state_.position, state_.attitude);
    const bool known = state_.coupled;
    ProxyPath path;
    const ProxyResult result =
        advance_proxy({&plate_.contact, 1}, tool_at(hand.attitude).parts(), hand, state_, {}, &path);
    PALPATE_CHECK(path.count < path.vertices.size());
    if (!state_.coupled) return;
    turned_.detected = turned_.detected || result.force_N.norm() > kDetectedTurn_N;
    const auto corner = [&](std::size_t n) { return ToolPose(path.vertices[n], path.attitudes[n]); };
    if (known) scan_along(before, corner(0));
    for (std::size_t n = 1; n < path.count; ++n) scan_along(corner(n - 1), corner(n));
    scan_along(corner(path.count - 1), {state_.position, state_.attitude});
  }

  void scan_along(const ToolPose& a, const ToolPose& b) {
    const double path_mm =
        (b.tip - a.tip).norm() + (lever_.norm() + 2) * a.attitude.angularDistance(b.attitude);
    const int pieces = static_cast<int>(path_mm / (has_shaft() ? kSampledShaft_mm : kSampled_mm)) + 1;
    for (int n = 1; n <= pieces; ++n) {
      const double part = static_cast<double>(n) / pieces;
      turned_.deepest_mm = std::max(turned_.deepest_mm, -clearance_mm(a.tip + (b.tip - a.tip) * part,
                                                                      a.attitude.slerp(part, b.attitude)));
    }
  }

  const RoundPlate& plate_;
  AccuracyRandom& random_;
  Eigen::Vector3d lever_, axis_;
  double begin_rad_ = 0, end_rad_ = 0, speed_rad_s_ = 0, tick_s_ = 0, jitter_ = 0;
  Point<Patient> tip_;
  std::vector<ToolPart> tool_;
  ProxyState state_;
  TurnedLever turned_;
};

}  // namespace

Result<std::vector<Figure>> turning_figures(int turns, const Progress& progress) {
  AccuracyRandom random(kTurningSeed);
  double deepest_mm = 0, shaft_deepest_mm = 0;
  int through = 0, missed = 0;
  for (int done = 0; done < turns;) {
    progress.report("turning levers through plates", static_cast<double>(done) / turns);
    const auto plate = round_plate(
        kPlateVoxels_mm[static_cast<std::size_t>(done / kTurnsOfAPlate) % std::size(kPlateVoxels_mm)],
        random);
    if (!plate) return plate.error();
    for (int turn = 0; turn < kTurnsOfAPlate && done < turns; ++turn, ++done) {
      if (progress.stopped()) return Progress::interrupted();
      const TurnedLever turned = TurningHand(*plate, random).run();
      double& deepest = turned.shaft ? shaft_deepest_mm : deepest_mm;
      deepest = std::max(deepest, turned.deepest_mm);
      through += turned.through;
      missed += !turned.detected;
    }
  }
  const auto n = static_cast<std::uint64_t>(turns);
  return std::vector<Figure>{
      {"stability/turning/deepest", deepest_mm, "mm", n, kProxySettings.max_penetration_mm},
      {"stability/turning/shaft-deepest", shaft_deepest_mm, "mm", n,
       kProxySettings.max_penetration_mm + kShaftDip_mm},
      {"stability/turning/through", static_cast<double>(through), "turns", n, 0},
      {"stability/turning/not-felt", static_cast<double>(missed), "turns", n, 0}};
}

}  // namespace palpate
