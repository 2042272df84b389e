#include "palpate/navigation/surface_registration.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <nanoflann.hpp>
#include <numbers>
#include <numeric>
#include <optional>

#include "palpate/geometry/decompositions.h"

namespace palpate {
namespace {

constexpr std::size_t kMinPoints = 12;
constexpr int kMaxIterations = 60;
constexpr double kDamping = 1e-5;

// points on the surface with outward normals, one per voxel that the surface intersects
struct Cloud {
  std::vector<Eigen::Vector3d> points, outward;

  std::size_t kdtree_get_point_count() const { return points.size(); }
  double kdtree_get_pt(std::size_t n, std::size_t axis) const {
    return points[n][static_cast<Eigen::Index>(axis)];
  }
  template <class Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }
};
using Tree =
    nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, Cloud>, Cloud, 3, std::size_t>;

struct SurfaceProjection {
  double distance_mm = 0;   // to the nearest point; positive outside
  double height_mm = 0;     // above the tangent plane there
  Eigen::Vector3d outward;  // normal of the tangent plane
};

std::optional<SurfaceProjection> project_by_field(const Surface& surface, const Eigen::Vector3d& x) {
  const FieldSample here = sample_central_differences(surface.distance_field(), Point<Patient>(x));
  const double slope = here.gradient.norm();
  // beyond its reach the distance field is constant
  if (slope < 0.5) return {};
  return SurfaceProjection{here.value / slope, here.value / slope, here.gradient.eigen() / slope};
}

Cloud sample_surface(const Surface& surface) {
  Cloud cloud;
  const Volume<float> values = surface.distance_field().values();
  const GridGeometry& grid = values.geometry();
  const Transform<Patient, Voxel> X_PatientVoxel = grid.X_PatientVoxel();
  const double near_mm = 0.5 * X_PatientVoxel.linear().colwise().norm().maxCoeff();
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) {
        if (std::abs(values.at(i, j, k)) > near_mm) continue;
        const Eigen::Vector3d x = (X_PatientVoxel * Point<Voxel>(i, j, k)).eigen();
        const auto foot = project_by_field(surface, x);
        if (!foot) continue;
        cloud.points.push_back(x - foot->distance_mm * foot->outward);
        cloud.outward.push_back(foot->outward);
      }
  return cloud;
}

struct Fit {
  Transform<Patient, Tracker> X;
  std::vector<SurfaceProjection> projections;
  std::vector<bool> counts;
  double rms_mm = 0;
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();  // centroid of the untrimmed points
  double radius_mm = 1;                              // RMS distance from the centroid
  Matrix6d information = Matrix6d::Zero();           // rotations scaled by radius_mm; per point
  Vector6d gradient = Vector6d::Zero();
};

class Fitter {
 public:
  Fitter(const Surface& surface, std::span<const Point<Tracker>> touched,
         const SurfaceRegistrationOptions& options)
      : surface_(surface), touched_(touched), options_(options), cloud_(sample_surface(surface)) {
    if (!cloud_.points.empty()) tree_.emplace(3, cloud_, nanoflann::KDTreeSingleIndexAdaptorParams(16));
  }
  bool is_empty() const { return cloud_.points.empty(); }

  // iterates to convergence
  Fit iterate(const Transform<Patient, Tracker>& start, bool by_field) const {
    Fit fit = fit_from(start, by_field);
    for (int turn = 0; turn < kMaxIterations; ++turn) {
      // damping keeps unconstrained directions unchanged
      const Matrix6d damped = fit.information + kDamping * Matrix6d::Identity();
      const Vector6d step = -solve_symmetric(damped, fit.gradient);
      const Eigen::Vector3d turned = step.tail<3>() / fit.radius_mm;
      const double angle = turned.norm();
      const Eigen::Matrix3d rotation =
          angle > 0 ? Eigen::AngleAxisd(std::min(angle, 0.2), turned / angle).toRotationMatrix()
                    : Eigen::Matrix3d::Identity();
      const Eigen::Vector3d shift = step.head<3>();
      const Transform<Patient, Patient> moved(rotation, fit.middle - rotation * fit.middle + shift);
      fit = fit_from(moved * fit.X, by_field);
      if (shift.norm() < 1e-5 && angle * fit.radius_mm < 1e-5) break;
    }
    return fit;
  }

 private:
  SurfaceProjection project_to_surface(const Eigen::Vector3d& x, bool by_field) const {
    if (by_field)
      if (const auto foot = project_by_field(surface_, x)) return *foot;
    std::size_t nearest = 0;
    double square = 0;
    nanoflann::KNNResultSet<double, std::size_t> found(1);
    found.init(&nearest, &square);
    tree_->findNeighbors(found, x.data(), nanoflann::SearchParams());
    const Eigen::Vector3d& outward = cloud_.outward[nearest];
    const double height_mm = (x - cloud_.points[nearest]).dot(outward);
    return {std::copysign(std::sqrt(square), height_mm), height_mm, outward};
  }

  Fit fit_from(const Transform<Patient, Tracker>& X, bool by_field) const {
    Fit fit;
    fit.X = X;
    std::vector<Eigen::Vector3d> at;
    for (const Point<Tracker>& point : touched_) {
      at.push_back((X * point).eigen());
      fit.projections.push_back(project_to_surface(at.back(), by_field));
      fit.projections.back().distance_mm -= options_.tip_radius_mm;
      fit.projections.back().height_mm -= options_.tip_radius_mm;
    }
    // ascending by residual; stable for ties
    std::vector<std::size_t> order(at.size());
    std::iota(order.begin(), order.end(), 0);
    std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
      return std::abs(fit.projections[a].distance_mm) < std::abs(fit.projections[b].distance_mm);
    });
    order.resize(std::max(
        kMinPoints, at.size() - static_cast<std::size_t>(options_.trimmed * static_cast<double>(at.size()))));
    fit.counts.assign(at.size(), false);
    const double count = static_cast<double>(order.size());
    for (const std::size_t n : order) {
      fit.counts[n] = true;
      fit.middle += at[n] / count;
    }
    double squares = 0;
    for (const std::size_t n : order) squares += (at[n] - fit.middle).squaredNorm() / count;
    fit.radius_mm = std::max(1e-6, std::sqrt(squares));
    for (const std::size_t n : order) {
      const auto& [distance_mm, height_mm, outward] = fit.projections[n];
      Vector6d row;
      row << outward, (at[n] - fit.middle).cross(outward) / fit.radius_mm;
      fit.information += row * row.transpose() / count;
      fit.gradient += row * height_mm / count;
      fit.rms_mm += distance_mm * distance_mm / count;
    }
    fit.rms_mm = std::sqrt(fit.rms_mm);
    return fit;
  }

  const Surface& surface_;
  std::span<const Point<Tracker>> touched_;
  const SurfaceRegistrationOptions& options_;
  Cloud cloud_;
  std::optional<Tree> tree_;
};

}  // namespace

Result<SurfaceRegistration> register_to_surface(const Surface& surface,
                                                std::span<const Point<Tracker>> touched,
                                                const Transform<Patient, Tracker>& start,
                                                const SurfaceRegistrationOptions& options,
                                                const Progress& progress) {
  const auto refuse = [](std::string what, std::string remedy) {
    return Error{ErrorKind::kBadInput, std::move(what), "", std::move(remedy)};
  };
  const auto formatted = [](const char* format, auto... numbers) {
    char text[200];
    std::snprintf(text, sizeof text, format, numbers...);
    return std::string(text);
  };
  if (touched.size() < kMinPoints)
    return refuse("a registration by a surface needs " + std::to_string(kMinPoints) +
                      " points at least, but there are " + std::to_string(touched.size()),
                  "touch more places, on all reachable sides of the structure");
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  for (std::size_t n = 0; n < touched.size(); ++n) {
    if (!touched[n].all_finite())
      return refuse(formatted("the coordinates of point %zu are not finite", n + 1), "touch it again");
    centre += (start * touched[n]).eigen() / static_cast<double>(touched.size());
  }
  const Fitter fitter(surface, touched, options);
  if (fitter.is_empty()) return refuse("the structure has no surface", "choose another");

  // started from perturbations as well, because the nearest points need not correspond
  constexpr double kShift_mm = 10, kTurn = 10 * std::numbers::pi / 180;
  std::optional<Fit> best;
  for (int n = 0; n < 13; ++n) {
    if (progress.stopped()) return Progress::interrupted();
    progress.report("register", n / 13.0);
    Transform<Patient, Patient> away;
    const Eigen::Vector3d axis = (n % 2 ? 1.0 : -1.0) * Eigen::Vector3d::Unit((n + 5) / 2 % 3);
    if (n > 6) {
      const Eigen::Matrix3d rotation = Eigen::AngleAxisd(kTurn, axis).toRotationMatrix();
      away = {rotation, centre - rotation * centre};
    } else if (n > 0) {
      away = {Eigen::Matrix3d::Identity(), kShift_mm * axis};
    }
    const Fit coarse = fitter.iterate(away * start, false);
    Fit fine = fitter.iterate(coarse.X, true);
    if (!best || fine.rms_mm < best->rms_mm) best = std::move(fine);
  }
  progress.report("register", 1);

  SurfaceRegistration out;
  out.patient_from_tracker = best->X;
  out.rms_mm = best->rms_mm;
  const SymmetricEigen<6> spectrum = symmetric_eigen(best->information);
  out.hold = spectrum.values[0];
  if (out.rms_mm > options.max_rms_mm)
    return refuse(
        formatted("the points do not fit the surface: the residual is %.2g mm (root mean square), at "
                  "most %.2g is allowed",
                  out.rms_mm, options.max_rms_mm),
        "check the structure and the side of the patient, and start closer: with points that are "
        "visible in the scan");
  const auto far = std::count_if(
      best->projections.begin(), best->projections.end(),
      [&](const SurfaceProjection& foot) { return std::abs(foot.distance_mm) > options.far_mm; });
  if (static_cast<double>(far) > options.max_far * static_cast<double>(touched.size()))
    return refuse(formatted("%d of %zu points are farther than %.2g mm from the surface",
                            static_cast<int>(far), touched.size(), options.far_mm),
                  "check the structure and the side of the patient, or touch again where the hand slipped");
  if (out.hold < options.min_hold) {
    const Vector6d open = spectrum.vectors.col(0);
    const bool shifts = open.head<3>().norm() > open.tail<3>().norm();
    const Eigen::Vector3d along = (shifts ? open.head<3>() : open.tail<3>()).normalized();
    return refuse(
        formatted("the points do not constrain %s (%.2f, %.2f, %.2f) in the patient: constraint %.2g of 1",
                  shifts ? "the translation along" : "the rotation about", along.x(), along.y(), along.z(),
                  out.hold),
        "also touch other sides of the structure");
  }
  for (std::size_t n = 0; n < touched.size(); ++n) {
    out.distances_mm.push_back(best->projections[n].distance_mm);
    out.is_trimmed.push_back(!best->counts[n]);
  }
  const Transform<Patient, Patient> moved = best->X * start.inverse();
  out.moved_mm = (moved * Point<Patient>(centre) - Point<Patient>(centre)).norm();
  out.turned_deg = Eigen::AngleAxisd(moved.linear()).angle() * 180 / std::numbers::pi;
  return out;
}

}  // namespace palpate
