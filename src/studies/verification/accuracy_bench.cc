#include "verification/accuracy_bench.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <utility>

#include "palpate/direct/direct_methods.h"
#include "verification/accuracy_fields.h"
#include "verification/accuracy_meter.h"
#include "verification/accuracy_random.h"
#include "verification/accuracy_truth.h"
#include "verification/smoothed_indicator.h"

namespace palpate {
namespace {

constexpr double kSigma_mm = 1.5, kNarrowSigma_mm = 1.0;
// number of points where the reference is a quadrature over lines
constexpr std::size_t kQuadraturePoints = 1000;
constexpr std::size_t kPaths = 64;
constexpr int kPathSteps = 300;

// Random paths on the surface, starting at the first of the case's points.
std::vector<std::vector<Point<Patient>>> paths_on(const AccuracyCase& shape) {
  std::vector<std::vector<Point<Patient>>> paths;
  if (!shape.with_paths) return paths;
  AccuracyRandom random(5);
  for (std::size_t n = 0; n < std::min(kPaths, shape.points.size()); ++n)
    paths.push_back(constant_depth_path(shape.shape, shape.points[n], Vector<Patient>(random.direction()),
                                        kChoppinessStep_mm, kPathSteps));
  return paths;
}

template <class Value>
AccuracyValues values_at(const AccuracyCase& shape, const Value& value,
                         std::size_t count = std::numeric_limits<std::size_t>::max()) {
  AccuracyValues values;
  for (std::size_t n = 0; n < std::min(count, shape.points.size()); ++n)
    values.push_back(value(shape.points[n]));
  return values;
}

AccuracyValues weighted_solid(const AccuracyCase& shape, const std::array<AxisWeight, 3>& weights) {
  return values_at(
      shape, [&](const Point<Patient>& p) { return smoothed_solid(shape.shape, p, weights); },
      kQuadraturePoints);
}

SmoothedTruth truth_of(const AccuracyCase& shape, double sigma_mm) {
  const AxisWeight weight = AxisWeight::compact(SmoothSphere::kRadiusPerSigma * sigma_mm);
  return {sigma_mm, values_at(shape, [&](const Point<Patient>& p) { return shape.smoothed(p, sigma_mm); }),
          weighted_solid(shape, {weight, weight, weight})};
}

struct Quantity {
  const char* name;
  const char* unit;
  double scale;
};
constexpr Quantity kMagnitude{"magnitude", "percent", 100}, kDistance{"distance", "um", 1000};

// Figures of one shape on one grid. It stops at the first error or an interruption.
class GridBench {
 public:
  GridBench(const ShapeTruth& truth, const std::string& on, const GridGeometry& grid,
            const Progress& progress)
      : truth_(truth), on_("/" + on), grid_(grid), progress_(progress) {}

  void add_voxelised() {
    const auto solid = kept(VoxelisedSolid::make(truth_.shape.shape, grid_));
    if (!solid) return;
    // prepared as by a scene, with all other settings that a scene can give a method
    if (auto model = kept(solid->prepared(kSigma_mm, 2))) {
      for (const ForceMethodInfo& info : kDirectMethods)
        add_method(std::string(info.name) + on_, *model, info.method, values_of(info.method, truth_.wide));
      model->method_settings.sphere_sigma_voxels = GaussianSphere::kMaxSigmaVoxels;
      add_method("gaussian-sphere-sigma-2" + on_, *model, ForceMethod::kGaussianSphere, {});
      model->method_settings.normals = NormalEncoding::kOctahedral16;
      add_method("stored-normals-oct16" + on_, *model, ForceMethod::kStoredNormals, truth_.wide.field);
      model->method_settings.normals = NormalEncoding::kOctahedral24;
      add_method("stored-normals-oct24" + on_, *model, ForceMethod::kStoredNormals, truth_.wide.field);
    }
    // the Gaussian sphere does not use this sigma
    if (const auto model = kept(solid->prepared(kNarrowSigma_mm, 2)))
      for (const ForceMethodInfo& info : kDirectMethods)
        if (info.method != ForceMethod::kGaussianSphere)
          add_method(std::string(info.name) + on_ + "/sigma-1.0", *model, info.method,
                     values_of(info.method, truth_.narrow), kWithoutChoppiness);
    if (const auto model = kept(solid->prepared(kSigma_mm, 1))) {
      add_method("trilinear-u8" + on_, *model, ForceMethod::kTrilinear, truth_.wide.field);
      add_method("b-spline-u8" + on_, *model, ForceMethod::kSpline, truth_.wide.field);
    }
  }

  void add_exact() {
    if (!continues()) return;
    const ExactSolid solid(truth_.shape.shape, grid_);
    for (const auto& [bytes, stored] : {std::pair{1, "-exact-u8"}, std::pair{2, "-exact-u16"}}) {
      Model model;
      model.field = std::make_shared<const Field>(solid.ramp_field(kSigma_mm, bytes));
      model.sigma_mm = kSigma_mm;
      model.tissues = {Tissue{}};
      for (const ForceMethod method :
           {ForceMethod::kTrilinear, ForceMethod::kSpline, ForceMethod::kStoredNormals})
        add_method(std::string(name_of(method)) + stored + on_, model, method, truth_.profile,
                   kWithoutChoppiness);
    }
    if (!continues()) return;
    const SplineField ramp(solid.ramp(kSigma_mm));
    compare(
        "b-spline-exact-int16" + on_, [&](const Point<Patient>& p) { return sample_spline(ramp, p); },
        truth_.profile, kMagnitude);
    if (!continues()) return;
    const SignedField distance = solid.distance_field();
    compare(
        "trilinear-exact-distance-int16" + on_,
        [&](const Point<Patient>& p) { return as_ramp(sample_central_differences(distance, p)); },
        truth_.distance, kDistance);
    const SplineField spline(distance);
    compare(
        "b-spline-exact-distance-int16" + on_,
        [&](const Point<Patient>& p) { return as_ramp(sample_spline(spline, p)); }, truth_.distance,
        kDistance);
  }

  Result<std::vector<Figure>> take() {
    if (error_) return *std::move(error_);
    return std::move(figures_);
  }

 private:
  enum WithChoppiness : bool { kWithoutChoppiness, kWithChoppiness };

  bool continues() {
    if (!error_ && progress_.stopped()) error_ = Progress::interrupted();
    return !error_;
  }

  template <class T>
  std::optional<T> kept(Result<T> result) {
    if (!result && !error_) error_ = result.error();
    if (!continues()) return {};
    return *std::move(result);
  }

  // the gradient of a distance points outward, that of a ramp inward
  static FieldSample as_ramp(const FieldSample& distance) { return {distance.value, -distance.gradient}; }

  AccuracyValues values_of(ForceMethod method, const SmoothedTruth& truth) const {
    if (method == ForceMethod::kSmoothSphere) return truth.smooth_sphere;
    if (method != ForceMethod::kGaussianSphere) return truth.field;
    // a width of one voxel
    return weighted_solid(
        truth_.shape, {AxisWeight::gaussian(grid_.spacing_mm[0]), AxisWeight::gaussian(grid_.spacing_mm[1]),
                       AxisWeight::gaussian(grid_.spacing_mm[2])});
  }

  // Adds the figures of a method; without values only choppiness.
  void add_method(const std::string& path, const Model& model, ForceMethod method,
                  const AccuracyValues& values, WithChoppiness with_choppiness = kWithChoppiness) {
    if (!continues()) return;
    const auto field = kept(make_force_field(model, method));
    if (!field) return;
    const Sampler sample = [&](const Point<Patient>& p) { return (*field)->sample(p); };
    if (!values.empty()) compare(path, sample, values, kMagnitude);
    if (with_choppiness == kWithChoppiness) add_choppiness(path, sample, method);
  }

  void compare(const std::string& path, const Sampler& sample, const AccuracyValues& values,
               const Quantity& quantity) {
    std::vector<double> direction, error;
    for (std::size_t n = 0; n < truth_.shape.points.size(); ++n) {
      const FieldSample field_sample = sample(truth_.shape.points[n]);
      direction.push_back(degrees_between(-field_sample.gradient.eigen(), truth_.normals[n]));
      if (n < values.size()) error.push_back(quantity.scale * std::abs(field_sample.value - values[n]));
    }
    add_spread(figures_, path + "/direction", "deg", std::move(direction));
    add_spread(figures_, path + "/" + quantity.name, quantity.unit, std::move(error));
  }

  // Adds choppiness; for the Gaussian sphere, steps in which the nearest voxel changes are reported
  // separately.
  void add_choppiness(const std::string& path, const Sampler& sample, ForceMethod method) {
    const Transform<Voxel, Patient> X_VoxelPatient = grid_.X_PatientVoxel().inverse();
    std::vector<double> all, at_half_voxels, between;
    for (const auto& surface_path : truth_.paths) {
      const std::vector<double> changes = force_changes_percent(sample, surface_path);
      for (std::size_t n = 0; n < changes.size(); ++n) {
        all.push_back(changes[n]);
        (same_nearest_voxel(X_VoxelPatient * surface_path[n], X_VoxelPatient * surface_path[n + 1])
             ? between
             : at_half_voxels)
            .push_back(changes[n]);
      }
    }
    add_spread(figures_, path + "/choppiness", "percent", std::move(all), kWithoutMean);
    if (method != ForceMethod::kGaussianSphere) return;
    add_spread(figures_, path + "/choppiness-at-half-voxels", "percent", std::move(at_half_voxels),
               kWithoutMean);
    add_spread(figures_, path + "/choppiness-between", "percent", std::move(between), kWithoutMean);
  }

  const ShapeTruth& truth_;
  std::string on_;
  GridGeometry grid_;
  const Progress& progress_;
  std::optional<Error> error_;
  std::vector<Figure> figures_;
};

}  // namespace

ShapeTruth::ShapeTruth(AccuracyCase accuracy_case)
    : shape(std::move(accuracy_case)),
      paths(paths_on(shape)),
      wide(truth_of(shape, kSigma_mm)),
      narrow(truth_of(shape, kNarrowSigma_mm)) {
  for (const Point<Patient>& p : shape.points) {
    normals.push_back(shape.shape.normal(p).eigen());
    distance.push_back(shape.shape.distance_mm(p));
    profile.push_back(smoothed_half_space(distance.back(), kSigma_mm));
  }
}

Result<std::vector<Figure>> measure_on_grid(const ShapeTruth& truth, const std::string& on,
                                            const Eigen::Vector3d& spacing_mm, const Progress& progress) {
  GridBench bench(truth, on, accuracy_grid(truth.shape, spacing_mm), progress);
  bench.add_voxelised();
  bench.add_exact();
  return bench.take();
}

}  // namespace palpate
