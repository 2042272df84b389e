#include <gtest/gtest.h>

#include <cstdlib>
#include <cstring>
#include <iostream>

#include "palpate/sampling/stored_normals.h"
#include "sampling/label_sphere_test_support.h"
#include "sampling/test_oracles.h"

// Every method on every SIMD target of the machine: compared with its oracle, and bit-identical to the other
// targets. PALPATE_TEST_POINTS sets the number of points.

namespace palpate {
namespace {

std::size_t point_count() {
  const char* value = std::getenv("PALPATE_TEST_POINTS");
#ifdef __SANITIZE_ADDRESS__
  constexpr std::size_t kDefault = 30'000;
#else
  constexpr std::size_t kDefault = 250'000;
#endif
  return value != nullptr ? std::strtoull(value, nullptr, 10) : kDefault;
}

/// Maximum differences from the oracle, as fractions of the field's range, and of the range per minimum
/// spacing.
struct Worst {
  double value = 0, gradient = 0;
  void add(const FieldSample& a, const FieldSample& b, double range, double spacing_mm) {
    value = std::max(value, std::abs(a.value - b.value) / range);
    gradient = std::max(gradient, (a.gradient - b.gradient).norm() * spacing_mm / range);
  }
};

bool same_bits(const std::vector<FieldSample>& a, const std::vector<FieldSample>& b) {
  return std::memcmp(static_cast<const void*>(a.data()), static_cast<const void*>(b.data()),
                     a.size() * sizeof(FieldSample)) == 0;
}

/// A method: its oracle, its single-point query and its batch query.
struct Method {
  std::function<FieldSample(const Point<Patient>&)> oracle, one;
  std::function<void(std::span<const Point<Patient>>, std::span<FieldSample>)> many;
  double range;
  double tolerance_one, tolerance_many;  ///< as fractions of the range
  /// Whether the gradient is discontinuous near a point, so that rounding decides the side.
  std::function<bool(const Point<Patient>&)> ends_abruptly = [](const auto&) { return false; };
};

void expect_all_targets_right(const GridGeometry& grid, const Method& method) {
  constexpr std::size_t kBlock = 4096;
  SCOPED_TRACE("seed " + std::to_string(test::kSeed));
  std::mt19937 random(test::kSeed);
  const auto targets = hwy::SupportedAndGeneratedTargets();
  std::vector<Worst> worst_one(targets.size()), worst_many(targets.size());
  std::vector<Point<Patient>> points = test::invalid_points(grid);
  for (const auto& p : test::border_points(grid)) {
    if (!method.ends_abruptly(p)) points.push_back(p);
  }

  const std::size_t blocks = point_count() / kBlock + 1;
  for (std::size_t block = 0; block <= blocks; ++block) {
    std::vector<FieldSample> expected(points.size()), one(points.size()), many(points.size());
    std::vector<FieldSample> first_one, first_many;
    std::transform(points.begin(), points.end(), expected.begin(), method.oracle);
    for (std::size_t t = 0; t < targets.size(); ++t) {
      SCOPED_TRACE(hwy::TargetName(targets[t]));
      const test::OnlyTargets only(targets[t]);
      std::transform(points.begin(), points.end(), one.begin(), method.one);
      method.many(points, many);
      for (std::size_t n = 0; n < points.size(); ++n) {
        worst_one[t].add(one[n], expected[n], method.range, grid.min_spacing_mm());
        worst_many[t].add(many[n], expected[n], method.range, grid.min_spacing_mm());
      }
      if (t == 0) first_one = one, first_many = many;
      ASSERT_TRUE(same_bits(one, first_one));
      ASSERT_TRUE(same_bits(many, first_many));
    }
    points.resize(kBlock);
    for (auto& p : points) p = test::random_point(grid, 2.5, random);
  }

  for (std::size_t t = 0; t < targets.size(); ++t) {
    const char* name = hwy::TargetName(targets[t]);
    std::cout << "  " << name << ", of the range: one " << worst_one[t].value << " " << worst_one[t].gradient
              << ", many " << worst_many[t].value << " " << worst_many[t].gradient << '\n';
    EXPECT_LT(worst_one[t].value, method.tolerance_one) << name;
    EXPECT_LT(worst_one[t].gradient, method.tolerance_one) << name;
    EXPECT_LT(worst_many[t].value, method.tolerance_many) << name;
    EXPECT_LT(worst_many[t].gradient, method.tolerance_many) << name;
  }
}

template <class AnyField>
Method central_differences(const AnyField& field, test::Values values, double range) {
  return {.oracle = test::SevenTrilinear(std::move(values)),
          .one = [&field](const Point<Patient>& p) { return sample_central_differences(field, p); },
          .many = [&field](auto points, auto samples) { sample_central_differences(field, points, samples); },
          .range = range,
          .tolerance_one = 1e-12,
          .tolerance_many = 1e-6};
}

const GridGeometry kGrid = test::make_grid({37, 29, 23}, 3);

TEST(SamplingTargets, CentralDifferencesOf8Bits) {
  std::mt19937 random(test::kSeed);
  const auto volume = test::random_volume<std::uint8_t>(kGrid, random);
  const Field field(volume);
  expect_all_targets_right(kGrid, central_differences(field, test::values_of(volume, 1 / 255.0, 0, 0), 1));
}

TEST(SamplingTargets, CentralDifferencesOf16Bits) {
  std::mt19937 random(test::kSeed);
  const auto volume = test::random_volume<std::uint16_t>(kGrid, random);
  const Field field(volume);
  expect_all_targets_right(kGrid, central_differences(field, test::values_of(volume, 1 / 65535.0, 0, 0), 1));
}

TEST(SamplingTargets, CentralDifferencesOfSignedNumbers) {
  std::mt19937 random(test::kSeed);
  const auto volume = test::random_volume<std::int16_t>(kGrid, random);
  const SignedSteps steps{.scale = 2e-3, .offset = 5, .outside = -4000};
  const SignedField field(volume, steps);
  const auto values = test::values_of(volume, steps.scale, steps.offset, field.outside());
  expect_all_targets_right(kGrid, central_differences(field, values, 65535 * steps.scale));
}

template <class T>
void expect_all_targets_right_on_a_spline(SplineStorage storage) {
  std::mt19937 random(test::kSeed);
  Volume<float> values(kGrid);
  std::uniform_real_distribution<float> value(-1, 1);
  for (float& v : values.voxels()) v = value(random);
  const SplineField field(values, {.storage = storage, .outside = 0.5});
  const auto& c = std::get<Bricks<T>>(field.coefficients());
  expect_all_targets_right(
      kGrid, {.oracle = test::SumOf64(test::values_of(c.dense(), field.scale(), 0, 0), field.outside()),
              .one = [&](const Point<Patient>& p) { return sample_spline(field, p); },
              .many = [&](auto points, auto samples) { sample_spline(field, points, samples); },
              .range = 2,
              .tolerance_one = 5e-6,
              .tolerance_many = 5e-6,
              .ends_abruptly =
                  [&](const Point<Patient>& p) {
                    const Eigen::Array3d x = (field.X_VoxelPatient() * p).eigen();
                    const Eigen::Array3d n(kGrid.dims[0], kGrid.dims[1], kGrid.dims[2]);
                    return ((x + 1).abs() < 1e-9).any() || ((x - n).abs() < 1e-9).any();
                  }});
}

TEST(SamplingTargets, SplineOf16Bits) {
  expect_all_targets_right_on_a_spline<std::int16_t>(SplineStorage::kInt16);
}

TEST(SamplingTargets, SplineOfFloats) {
  expect_all_targets_right_on_a_spline<float>(SplineStorage::kFloat);
}

/// Compares a method with its own literal form.
template <class AnyMethod>
void expect_all_targets_literal(const AnyMethod& method, double tolerance) {
  expect_all_targets_right(kGrid,
                           {.oracle = [&](const Point<Patient>& p) { return method.sample_literal(p); },
                            .one = [&](const Point<Patient>& p) { return method.sample(p); },
                            .many = [&](auto points, auto samples) { method.sample(points, samples); },
                            .range = 1,
                            .tolerance_one = tolerance,
                            .tolerance_many = tolerance});
}

LabelVoxels random_members() {
  std::mt19937 random(test::kSeed);
  return {internal::random_labels(kGrid, random), {1, 2, 3}};
}

TEST(SamplingTargets, GaussianSphere) {
  expect_all_targets_literal(GaussianSphere::make(random_members(), 1).value(), 1e-5);
}

TEST(SamplingTargets, SmoothSphereOfFourVoxels) {
  expect_all_targets_literal(SmoothSphere::make(random_members(), 0.05).value(), 1e-5);
}

TEST(SamplingTargets, SmoothSphereOfManyVoxels) {
  expect_all_targets_literal(SmoothSphere::make(random_members(), 0.5).value(), 1e-5);
}

TEST(SamplingTargets, StoredNormals) {
  std::mt19937 random(test::kSeed);
  const auto ramp = test::random_volume<std::uint16_t>(kGrid, random);
  for (const auto encoding :
       {NormalEncoding::kBytes, NormalEncoding::kOctahedral16, NormalEncoding::kOctahedral24}) {
    // where the normals nearly cancel, the direction of their sum is less accurate
    expect_all_targets_literal(StoredNormals::from_ramp(ramp, encoding), 1e-4);
  }
}

}  // namespace
}  // namespace palpate
