#include <gtest/gtest.h>

#include <cmath>

#include "base/test_processors.h"
#include "sampling/spline_prefilter.h"
#include "sampling/test_oracles.h"

namespace palpate {
namespace {

using test::make_grid;

Volume<float> random_values(const GridGeometry& grid, std::mt19937& random) {
  Volume<float> values(grid);
  std::uniform_real_distribution<float> value(-1, 1);
  for (float& v : values.voxels()) v = value(random);
  return values;
}

test::SumOf64 oracle_of(const SplineField& field) {
  return std::visit(
      [&](const auto& c) {
        return test::SumOf64(test::values_of(c.dense(), field.scale(), 0, 0), field.outside());
      },
      field.coefficients());
}

// ---- prefilter -----------------------------------------------------------------------------------------

TEST(SplinePrefilter, SplineOfCoefficientsReproducesTheValues) {
  // (c[k-1] + 4 c[k] + c[k+1]) / 6 along every axis, with 0 beyond the ends
  std::mt19937 random(test::kSeed);
  for (const auto& dims :
       {std::array{40, 33, 21}, std::array{7, 2, 5}, std::array{1, 9, 3}, std::array{1, 1, 1}}) {
    const auto values = random_values(make_grid(dims, 0), random);
    auto c = values;
    internal::spline_prefilter(c, 2);
    for (int k = 0; k < dims[2]; ++k) {
      for (int j = 0; j < dims[1]; ++j) {
        for (int i = 0; i < dims[0]; ++i) {
          double sum = 0;
          for (int n = 0; n < 27; ++n) {
            const int di = n % 3 - 1, dj = n / 3 % 3 - 1, dk = n / 9 - 1;
            const int weight = (di == 0 ? 4 : 1) * (dj == 0 ? 4 : 1) * (dk == 0 ? 4 : 1);
            sum += weight / 216.0 * static_cast<double>(c.at_or(i + di, j + dj, k + dk, 0));
          }
          ASSERT_NEAR(sum, values.at(i, j, k), 3e-6);
        }
      }
    }
  }
}

TEST(SplinePrefilter, IsBitIdenticalForAnyNumberOfThreads) {
  std::mt19937 random(test::kSeed);
  const auto values = random_values(make_grid({30, 19, 23}, 0), random);
  auto alone = values;
  internal::spline_prefilter(alone, 1);
  for (const int threads : {0, 2, 3, 64}) {
    auto together = values;
    internal::spline_prefilter(together, threads);
    EXPECT_EQ(together.voxels(), alone.voxels()) << threads << " threads";
  }
}

TEST(SplinePrefilter, WorksWithoutThreads) {
  std::mt19937 random(test::kSeed);
  auto alone = random_values(make_grid({30, 19, 23}, 0), random), refused = alone;
  internal::spline_prefilter(alone, 1);
  const test::NoThreads none;
  internal::spline_prefilter(refused, 4);
  EXPECT_EQ(refused.voxels(), alone.voxels());
}

TEST(SplinePrefilter, TurnsAnImpulseIntoPowersOfThePole) {
  // Unser 1999: the interpolating cubic spline's coefficients of an impulse are c z^|n|, z = sqrt(3) - 2
  Volume<float> impulse(make_grid({41, 1, 1}, 0));
  impulse.at(20, 0, 0) = 1;
  internal::spline_prefilter(impulse, 1);
  // a single voxel along j and k, where 4 c = 6 f
  const double z = std::sqrt(3.0) - 2, cross = 1.5 * 1.5;
  for (int n = -8; n <= 8; ++n) {
    EXPECT_NEAR(impulse.at(20 + n, 0, 0), cross * std::sqrt(3.0) * std::pow(z, std::abs(n)), 2e-6) << n;
  }
}

// ---- spline -------------------------------------------------------------------------------------------

TEST(Spline, PassesThroughItsVoxels) {
  std::mt19937 random(test::kSeed);
  for (int kind = 0; kind < 4; ++kind) {
    const auto values = random_values(make_grid({8, 5, 6}, kind), random);
    const SplineField floats(values, {.storage = SplineStorage::kFloat, .outside = 0.5});
    const SplineField steps(values, {.storage = SplineStorage::kInt16, .outside = 0.5});
    for (int k = 0; k < 6; ++k) {
      for (int j = 0; j < 5; ++j) {
        for (int i = 0; i < 8; ++i) {
          const auto p = values.geometry().X_PatientVoxel() * Point<Voxel>(i, j, k);
          EXPECT_NEAR(sample_spline(floats, p).value, values.at(i, j, k), 1e-5);
          // the weights add up to 1, so the error is at most half a step
          EXPECT_NEAR(sample_spline(steps, p).value, values.at(i, j, k), 0.5 * steps.scale() + 1e-5);
        }
      }
    }
  }
}

TEST(Spline, EqualsTheSumOf64TermsOnAnyGrid) {
  SCOPED_TRACE("seed " + std::to_string(test::kSeed));
  std::mt19937 random(test::kSeed);
  for (const auto& dims : {std::array{9, 7, 8}, std::array{4, 4, 4}, std::array{2, 3, 2}, std::array{1, 6, 1},
                           std::array{5, 1, 3}, std::array{1, 1, 1}}) {
    for (int kind = 0; kind < 4; ++kind) {
      const auto values = random_values(make_grid(dims, kind), random);
      for (const auto storage : {SplineStorage::kInt16, SplineStorage::kFloat}) {
        const SplineField field(values, {.storage = storage, .outside = -0.25});
        const auto oracle = oracle_of(field);
        for (int n = 0; n < 200; ++n) {
          const auto p = test::random_point(values.geometry(), 2.5, random);
          const FieldSample expected = oracle(p), sample = sample_spline(field, p);
          ASSERT_NEAR(sample.value, expected.value, 1e-5);
          ASSERT_LT((sample.gradient - expected.gradient).norm(), 1e-4);
        }
      }
    }
  }
}

TEST(Spline, EqualsTheSumOf64TermsOnEveryFaceEdgeAndCorner) {
  // a grid with exactly representable points, because the gradient is discontinuous one voxel outside
  std::mt19937 random(test::kSeed);
  const auto values = random_values(make_grid({5, 6, 4}, 0), random);
  const SplineField field(values, {.storage = SplineStorage::kInt16, .outside = 0.125});
  const auto oracle = oracle_of(field);
  for (const auto& p : test::border_points(values.geometry())) {
    const FieldSample expected = oracle(p), sample = sample_spline(field, p);
    EXPECT_NEAR(sample.value, expected.value, 1e-5);
    EXPECT_LT((sample.gradient - expected.gradient).norm(), 1e-5);
  }
}

TEST(Spline, BlendsToTheOutsideValueOneVoxelBeyondTheGrid) {
  std::mt19937 random(test::kSeed);
  const auto values = random_values(make_grid({6, 5, 7}, 1), random);
  const SplineField field(values, {.storage = SplineStorage::kFloat, .outside = 3});
  for (const double x : {-1 + 1e-7, -1 - 1e-7, 6 - 1e-7, 6 + 1e-7}) {
    const auto p = values.geometry().X_PatientVoxel() * Point<Voxel>(x, 2.3, 4.4);
    EXPECT_NEAR(sample_spline(field, p).value, 3, 1e-5) << x;
  }
  for (const auto& p : test::invalid_points(values.geometry())) {
    EXPECT_EQ(sample_spline(field, p).value, 3);
    EXPECT_EQ(sample_spline(field, p).gradient, Vector<Patient>());
  }
}

TEST(Spline, GradientIsTheDerivativeOfTheValue) {
  std::mt19937 random(test::kSeed);
  const auto values = random_values(make_grid({9, 8, 7}, 3), random);
  const SplineField field(values, {.storage = SplineStorage::kFloat});
  const auto oracle = oracle_of(field);
  constexpr double h = 1e-4;
  for (int n = 0; n < 500; ++n) {
    const auto p = test::random_point(values.geometry(), 0, random);
    const auto gradient = sample_spline(field, p).gradient;
    for (int axis = 0; axis < 3; ++axis) {
      const Vector<Patient> step(h * Eigen::Vector3d::Unit(axis));
      EXPECT_NEAR(gradient[axis], (oracle(p + step).value - oracle(p - step).value) / (2 * h), 2e-4);
    }
  }
}

TEST(Spline, ReproducesACubicPolynomialAwayFromTheBorder) {
  // cubic splines reproduce cubics; the influence of the boundary decays by |z| = 0.27 per voxel
  const GridGeometry grid = make_grid({48, 48, 48}, 0);
  const auto cubic = [&](const Eigen::Vector3d& x) {
    const double s = (x[0] - 24) / 24, t = (x[1] - 24) / 24, r = (x[2] - 24) / 24;
    return s * s * s - 0.5 * s * t * t + 0.25 * r * r * t + s * r;
  };
  Volume<float> values(grid);
  for (int k = 0; k < 48; ++k) {
    for (int j = 0; j < 48; ++j) {
      for (int i = 0; i < 48; ++i) {
        values.at(i, j, k) = static_cast<float>(cubic(Eigen::Vector3d(i, j, k)));
      }
    }
  }
  const SplineField field(values, {.storage = SplineStorage::kFloat});
  std::mt19937 random(test::kSeed);
  for (int n = 0; n < 500; ++n) {
    const auto p = test::random_point(grid, -16, random);
    const Eigen::Vector3d x = (field.X_VoxelPatient() * p).eigen();
    const FieldSample sample = sample_spline(field, p);
    EXPECT_NEAR(sample.value, cubic(x), 2e-6);
    for (int axis = 0; axis < 3; ++axis) {
      const Eigen::Vector3d h = 1e-4 * Eigen::Vector3d::Unit(axis);
      EXPECT_NEAR(sample.gradient[axis], (cubic(x + h) - cubic(x - h)) / 2e-4, 2e-6);
    }
  }
}

TEST(Spline, MatchesItsSourceField) {
  std::mt19937 random(test::kSeed);
  const GridGeometry grid = make_grid({6, 7, 8}, 2);
  const Field bytes(test::random_volume<std::uint8_t>(grid, random));
  const Field words(test::random_volume<std::uint16_t>(grid, random));
  const SignedField distances(test::random_volume<std::int16_t>(grid, random),
                              {.scale = 1e-3, .offset = 2, .outside = 30000});
  const SplineOptions options{.storage = SplineStorage::kFloat};
  const SplineField of_bytes(bytes, options), of_words(words, options), of_distances(distances, options);
  EXPECT_EQ(of_bytes.outside(), 0);
  EXPECT_DOUBLE_EQ(of_distances.outside(), 32);
  for (int n = 0; n < 50; ++n) {
    const Point<Voxel> at(static_cast<double>(random() % 6), static_cast<double>(random() % 7),
                          static_cast<double>(random() % 8));
    const auto p = grid.X_PatientVoxel() * at;
    EXPECT_NEAR(sample_spline(of_bytes, p).value, sample_value(bytes, p), 1e-5);
    EXPECT_NEAR(sample_spline(of_words, p).value, sample_value(words, p), 1e-5);
    EXPECT_NEAR(sample_spline(of_distances, p).value, sample_value(distances, p), 1e-3);
  }
}

TEST(Spline, DefaultSplineIsZeroAndUniformIsFlat) {
  const SplineField nothing;
  EXPECT_EQ(sample_spline(nothing, Point<Patient>(0, 0, 0)).value, 0);
  const SplineField flat(Volume<float>(make_grid({3, 3, 3}, 0), 2.f), {.outside = 2});
  EXPECT_EQ(sample_spline(flat, flat.geometry().centre()).value, 2);
}

TEST(Spline, ReportsItsStorage) {
  const Volume<float> values(make_grid({2, 3, 4}, 0));
  EXPECT_EQ(SplineField(values).bytes_per_voxel(), 2);
  EXPECT_EQ(SplineField(values, {.storage = SplineStorage::kFloat}).bytes_per_voxel(), 4);
  EXPECT_EQ(SplineField(values).geometry().dims, values.geometry().dims);
}

}  // namespace
}  // namespace palpate
