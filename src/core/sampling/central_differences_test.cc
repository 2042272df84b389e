#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "sampling/test_oracles.h"

namespace palpate {
namespace {

using test::make_grid;

// ---- uniform access to the storage types -----------------------------------------------------------

/// A field of a storage type, with the scale, offset and outside value of its stored numbers.
template <class T>
struct Stored {
  using Field = palpate::Field;
  static constexpr double kScale = 1.0 / std::numeric_limits<T>::max(), kOffset = 0, kOutside = 0;
  static Field field(const Volume<T>& volume) { return Field(volume); }
};
template <>
struct Stored<std::int16_t> {
  using Field = SignedField;
  static constexpr double kScale = 1e-4, kOffset = -0.25;
  static constexpr std::int16_t kOutsideSteps = 12000;
  static constexpr double kOutside = kOffset + kScale * kOutsideSteps;
  static Field field(const Volume<std::int16_t>& volume) {
    return {volume, {.scale = kScale, .offset = kOffset, .outside = kOutsideSteps}};
  }
};

template <class T>
test::Values values_of(const Volume<T>& volume) {
  return test::values_of(volume, Stored<T>::kScale, Stored<T>::kOffset, Stored<T>::kOutside);
}

template <class T>
void expect_oracle(const typename Stored<T>::Field& field, const test::SevenTrilinear& oracle,
                   const Point<Patient>& p) {
  const FieldSample expected = oracle(p), sample = sample_central_differences(field, p);
  const auto voxel = (field.X_VoxelPatient() * p).eigen().transpose();
  EXPECT_NEAR(sample.value, expected.value, 1e-11) << "at voxel " << voxel;
  EXPECT_LT((sample.gradient - expected.gradient).norm(), 1e-10) << "at voxel " << voxel;
  EXPECT_NEAR(sample_value(field, p), expected.value, 1e-11) << "at voxel " << voxel;
}

template <class T>
class CentralDifferences : public testing::Test {};
using Storages = testing::Types<std::uint8_t, std::uint16_t, std::int16_t>;
TYPED_TEST_SUITE(CentralDifferences, Storages);

// ---- definition ---------------------------------------------------------------------------------------

TYPED_TEST(CentralDifferences, EqualSevenTrilinearInterpolationsAnywhere) {
  SCOPED_TRACE("seed " + std::to_string(test::kSeed));
  std::mt19937 random(test::kSeed);
  for (const auto& dims : {std::array{9, 7, 8}, std::array{4, 4, 4}, std::array{2, 3, 2}, std::array{1, 6, 1},
                           std::array{5, 1, 3}, std::array{1, 1, 1}}) {
    for (int kind = 0; kind < 4; ++kind) {
      const auto volume = test::random_volume<TypeParam>(make_grid(dims, kind), random);
      const auto field = Stored<TypeParam>::field(volume);
      const test::SevenTrilinear oracle(values_of(volume));
      for (int n = 0; n < 400; ++n) {
        expect_oracle<TypeParam>(field, oracle, test::random_point(volume.geometry(), 3.5, random));
      }
    }
  }
}

TYPED_TEST(CentralDifferences, EqualTheOracleOnEveryFaceEdgeAndCorner) {
  // at integer coordinates the interpolant has kinks in its gradient, but none in its value or its
  // differences, so every combination of border coordinates has a defined result
  std::mt19937 random(test::kSeed);
  const auto volume = test::random_volume<TypeParam>(make_grid({5, 6, 4}, 0), random);
  const auto field = Stored<TypeParam>::field(volume);
  const test::SevenTrilinear oracle(values_of(volume));
  for (const auto& p : test::border_points(volume.geometry())) expect_oracle<TypeParam>(field, oracle, p);
}

TYPED_TEST(CentralDifferences, EqualTheOracleWhereBricksMeet) {
  std::mt19937 random(test::kSeed);
  const GridGeometry grid = make_grid({31, 31, 31}, 3);
  const auto volume = test::random_volume<TypeParam>(grid, random);
  const auto field = Stored<TypeParam>::field(volume);
  const test::SevenTrilinear oracle(values_of(volume));
  // bricks begin at cells 12 and 28
  const std::array at{11.0, 11.5, 12.0, 12.5, 13.0, 27.0, 27.5, 28.0, 28.5, 29.0};
  for (const double i : at)
    for (const double j : at)
      for (const double k : at)
        expect_oracle<TypeParam>(field, oracle, grid.X_PatientVoxel() * Point<Voxel>(i, j, k));
}

TYPED_TEST(CentralDifferences, AreHalfTheDifferenceOfNeighboursAtVoxelCentres) {
  std::mt19937 random(3);
  const auto volume = test::random_volume<TypeParam>(make_grid({6, 6, 6}, 0), random);
  const auto field = Stored<TypeParam>::field(volume);
  const double step = Stored<TypeParam>::kScale;
  const Point<Patient> p = volume.geometry().X_PatientVoxel() * Point<Voxel>(2, 3, 4);
  const FieldSample sample = sample_central_differences(field, p);
  EXPECT_DOUBLE_EQ(sample.value, Stored<TypeParam>::kOffset + step * volume.at(2, 3, 4));
  EXPECT_NEAR(sample.gradient.x(), (volume.at(3, 3, 4) - volume.at(1, 3, 4)) * step / 2, 1e-13);
  EXPECT_NEAR(sample.gradient.y(), (volume.at(2, 4, 4) - volume.at(2, 2, 4)) * step / 2, 1e-13);
  EXPECT_NEAR(sample.gradient.z(), (volume.at(2, 3, 5) - volume.at(2, 3, 3)) * step / 2, 1e-13);
}

TYPED_TEST(CentralDifferences, AreExactOnALinearFieldOfAnyGrid) {
  // stored = 40 + 3 i + 5 j + 7 k
  for (int kind = 0; kind < 4; ++kind) {
    const GridGeometry grid = make_grid({7, 7, 7}, kind);
    Volume<TypeParam> volume(grid);
    for (int k = 0; k < 7; ++k) {
      for (int j = 0; j < 7; ++j) {
        for (int i = 0; i < 7; ++i) volume.at(i, j, k) = static_cast<TypeParam>(40 + 3 * i + 5 * j + 7 * k);
      }
    }
    const auto field = Stored<TypeParam>::field(volume);
    const double step = Stored<TypeParam>::kScale;
    const Point<Patient> p = grid.X_PatientVoxel() * Point<Voxel>(2.3, 4.1, 1.7);
    const FieldSample sample = sample_central_differences(field, p);
    EXPECT_NEAR(sample.value, Stored<TypeParam>::kOffset + step * (40 + 3 * 2.3 + 5 * 4.1 + 7 * 1.7), 1e-12);

    // along each grid axis the value changes by the gradient's component per mm
    const Eigen::Vector3d along = grid.direction.transpose() * sample.gradient.eigen();
    EXPECT_NEAR(along[0], 3 * step / grid.spacing_mm[0], 1e-12);
    EXPECT_NEAR(along[1], 5 * step / grid.spacing_mm[1], 1e-12);
    EXPECT_NEAR(along[2], 7 * step / grid.spacing_mm[2], 1e-12);
  }
}

// ---- outside ----------------------------------------------------------------------------------------

TYPED_TEST(CentralDifferences, GoToTheValueOutsideLinearlyOverOneVoxel) {
  const GridGeometry grid = make_grid({4, 4, 4}, 1);
  constexpr TypeParam kStored = 200;
  const auto field = Stored<TypeParam>::field(Volume<TypeParam>(grid, kStored));
  const double outside = Stored<TypeParam>::kOutside;
  const double inside = Stored<TypeParam>::kOffset + Stored<TypeParam>::kScale * kStored;
  const auto point = [&](double i) { return grid.X_PatientVoxel() * Point<Voxel>(i, 1.5, 1.5); };
  for (const auto& [i, fraction] : {std::pair{0.0, 1.0}, {-0.25, 0.75}, {-0.75, 0.25}, {3.75, 0.25}}) {
    EXPECT_NEAR(sample_value(field, point(i)), outside + fraction * (inside - outside), 1e-12) << i;
  }
  EXPECT_DOUBLE_EQ(sample_value(field, point(-1.25)), outside);
  EXPECT_DOUBLE_EQ(sample_value(field, point(4.25)), outside);
  // the gradient there points towards the larger value
  const auto gradient = sample_central_differences(field, point(-0.5)).gradient;
  EXPECT_GT(gradient.dot(Vector<Patient>(grid.direction.col(0))) * (inside - outside), 0);
}

TYPED_TEST(CentralDifferences, AreThoseOfTheOutsideForWhatIsNoPlace) {
  const auto field = Stored<TypeParam>::field(Volume<TypeParam>(make_grid({4, 4, 4}, 2), TypeParam{99}));
  const auto points = test::invalid_points(field.geometry());
  std::vector<FieldSample> samples(points.size());
  sample_central_differences(field, points, samples);
  for (std::size_t n = 0; n < points.size(); ++n) {
    const FieldSample one = sample_central_differences(field, points[n]);
    EXPECT_DOUBLE_EQ(one.value, Stored<TypeParam>::kOutside) << points[n].eigen().transpose();
    EXPECT_EQ(one.gradient, Vector<Patient>());
    EXPECT_DOUBLE_EQ(sample_value(field, points[n]), Stored<TypeParam>::kOutside);
    EXPECT_NEAR(samples[n].value, Stored<TypeParam>::kOutside, 1e-6);
    EXPECT_EQ(samples[n].gradient, Vector<Patient>());
  }
}

// ---- batches ----------------------------------------------------------------------------------------

TYPED_TEST(CentralDifferences, OfAnyNumberOfPointsAreThoseOfEachAlone) {
  std::mt19937 random(test::kSeed);
  const auto volume = test::random_volume<TypeParam>(make_grid({11, 6, 9}, 3), random);
  const auto field = Stored<TypeParam>::field(volume);
  const double range = Stored<TypeParam>::kScale * std::numeric_limits<TypeParam>::max();
  for (const std::size_t count : {0, 1, 2, 31, 32, 33, 64, 100}) {
    std::vector<Point<Patient>> points(count);
    for (auto& p : points) p = test::random_point(volume.geometry(), 3, random);
    std::vector<FieldSample> samples(count);
    sample_central_differences(field, points, samples);
    for (std::size_t n = 0; n < count; ++n) {
      const FieldSample one = sample_central_differences(field, points[n]);
      EXPECT_NEAR(samples[n].value, one.value, 1e-6 * range);
      EXPECT_LT((samples[n].gradient - one.gradient).norm(), 4e-6 * range);
    }
  }
}

}  // namespace
}  // namespace palpate
