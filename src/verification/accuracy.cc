#include "verification/accuracy.h"

#include <algorithm>
#include <cmath>
#include <new>
#include <numbers>

#include "palpate/preparation.h"
#include "palpate/sampling.h"
#include "verification/accuracy_cases.h"
#include "verification/smoothed_indicator.h"

// For every shape and spacing: voxelise to 0 and 1, smooth, store, sample. Compared are
//   direction   -gradient / |gradient| with the surface's own normal at that point, degrees
//   magnitude   the value with what a perfect Gaussian filter makes of the solid, percent of full force.
// A second volume holds the normal distribution of -distance / sigma at every voxel centre and is compared
// with that function: what is left there is interpolation and storage alone, without voxelisation.
namespace palpate {
namespace {

constexpr int kPoints = 4000;
constexpr double kSigma_mm = 1.5, kNarrowSigma_mm = 1.0;

struct Spacing {
  const char* name;
  Eigen::Vector3d mm;
};
const std::vector<Spacing>& spacings() {
  static const std::vector<Spacing> all = {{"0.28x0.28x1.0", {0.28, 0.28, 1.0}},
                                           {"0.625x0.625x0.9", {0.625, 0.625, 0.9}},
                                           {"0.3x0.3x0.3", {0.3, 0.3, 0.3}}};
  return all;
}

// What one shape's points are compared with; computed once for all spacings.
struct Truth {
  std::vector<Eigen::Vector3d> normal;
  std::vector<double> smoothed, narrow, profile;
};

Truth truth_of(const AccuracyCase& shape) {
  Truth truth;
  for (const Point<Patient>& p : shape.points) {
    truth.normal.push_back(shape.shape.normal(p).eigen());
    truth.smoothed.push_back(shape.smoothed(p, kSigma_mm));
    truth.narrow.push_back(shape.smoothed(p, kNarrowSigma_mm));
    truth.profile.push_back(smoothed_half_space(shape.shape.distance_mm(p), kSigma_mm));
  }
  return truth;
}

double degrees_between(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  // no gradient, no direction: as wrong as can be
  if (a.squaredNorm() == 0) return 180;
  return std::atan2(a.cross(b).norm(), a.dot(b)) * 180 / std::numbers::pi;
}

void add_figures(std::vector<Figure>& figures, const std::string& path, const char* unit,
                 std::vector<double> errors) {
  std::sort(errors.begin(), errors.end());
  const auto n = errors.size();
  double sum = 0;
  for (const double e : errors) sum += e;
  const auto add = [&](const char* leaf, double value) {
    const std::string name = path + "/" + leaf;
    figures.push_back({name, value, unit, n, accuracy_limit(name)});
  };
  add("mean", sum / static_cast<double>(n));
  add("p99", errors[(n * 99 + 99) / 100 - 1]);
  add("max", errors.back());
}

void compare(std::vector<Figure>& figures, const std::string& path, const AccuracyCase& shape,
             const Field& field, const std::vector<Eigen::Vector3d>& normals,
             const std::vector<double>& values) {
  std::vector<double> direction, magnitude;
  for (std::size_t i = 0; i < shape.points.size(); ++i) {
    const FieldSample sample = sample_central_differences(field, shape.points[i]);
    direction.push_back(degrees_between(-sample.gradient.eigen(), normals[i]));
    magnitude.push_back(100 * std::abs(sample.value - values[i]));
  }
  add_figures(figures, path + "/direction", "deg", std::move(direction));
  add_figures(figures, path + "/magnitude", "percent", std::move(magnitude));
}

Result<Volume<std::uint8_t>> binary_volume(const Shape& shape, const GridGeometry& grid) {
  const auto labels = voxelize_binary(shape, grid);
  if (!labels) return labels.error();
  Volume<std::uint8_t> bytes(grid);
  std::transform(labels->voxels().begin(), labels->voxels().end(), bytes.voxels().begin(),
                 [](LabelId label) { return static_cast<std::uint8_t>(label == 0 ? 0 : 255); });
  return bytes;
}

Volume<std::uint16_t> exact_volume(const Shape& shape, const GridGeometry& grid) {
  Volume<std::uint16_t> volume(grid);
  const Transform<Patient, Voxel> X_PatientVoxel = grid.X_PatientVoxel();
  for (int k = 0; k < grid.dims[2]; ++k) {
    for (int j = 0; j < grid.dims[1]; ++j) {
      for (int i = 0; i < grid.dims[0]; ++i) {
        const double d = shape.distance_mm(X_PatientVoxel * Point<Voxel>(i, j, k));
        volume.at(i, j, k) =
            static_cast<std::uint16_t>(std::lround(65535 * smoothed_half_space(d, kSigma_mm)));
      }
    }
  }
  return volume;
}

Result<void> add_shape_on_grid(std::vector<Figure>& figures, const AccuracyCase& shape, const Truth& truth,
                               const Spacing& spacing, const Progress& progress) {
  const std::string on = "/" + shape.name + "/" + spacing.name;
  const GridGeometry grid = accuracy_grid(shape, spacing.mm);
  const auto binary = binary_volume(shape.shape, grid);
  if (!binary) return binary.error();

  auto field = gaussian_smooth_16(*binary, {.sigma_mm = kSigma_mm});
  if (!field) return field.error();
  compare(figures, "trilinear" + on, shape, Field(*std::move(field)), truth.normal, truth.smoothed);
  if (progress.stopped()) return Progress::interrupted();

  auto narrow = gaussian_smooth_16(*binary, {.sigma_mm = kNarrowSigma_mm});
  if (!narrow) return narrow.error();
  compare(figures, "trilinear" + on + "/sigma-1.0", shape, Field(*std::move(narrow)), truth.normal,
          truth.narrow);
  if (progress.stopped()) return Progress::interrupted();

  auto bytes = gaussian_smooth(*binary, {.sigma_mm = kSigma_mm});
  if (!bytes) return bytes.error();
  compare(figures, "trilinear-u8" + on, shape, Field(*std::move(bytes)), truth.normal, truth.smoothed);
  if (progress.stopped()) return Progress::interrupted();

  compare(figures, "trilinear-exact" + on, shape, Field(exact_volume(shape.shape, grid)), truth.normal,
          truth.profile);
  return {};
}

}  // namespace

Result<std::vector<Figure>> run_accuracy(const Progress& progress) try {
  std::vector<Figure> figures;
  const std::vector<AccuracyCase> cases = accuracy_cases(kPoints);
  const double steps = static_cast<double>(cases.size() * spacings().size());
  double done = 0;
  for (const AccuracyCase& shape : cases) {
    const Truth truth = truth_of(shape);
    for (const Spacing& spacing : spacings()) {
      progress.report("accuracy", done / steps);
      if (progress.stopped()) return Progress::interrupted();
      const auto added = add_shape_on_grid(figures, shape, truth, spacing, progress);
      if (!added) return added.error();
      ++done;
    }
  }
  progress.report("accuracy", 1);
  // all of one method together
  std::stable_sort(figures.begin(), figures.end(), [](const Figure& a, const Figure& b) {
    return a.name.substr(0, a.name.find('/')) < b.name.substr(0, b.name.find('/'));
  });
  return figures;
} catch (const std::bad_alloc&) {
  return Error{ErrorKind::kBadInput, "not enough memory for the accuracy suite", "", "it needs about 100 MB"};
}

}  // namespace palpate
