#include <gtest/gtest.h>

#include <cstring>
#include <iostream>

#include "palpate/base/hash.h"
#include "sampling/label_sphere_test_support.h"

namespace palpate {
namespace {

using test::make_grid;

constexpr unsigned kSeed = 20261120;

/// Compares bits, because -0 and 0 have different hashes.
bool same_bits(const FieldSample& a, const FieldSample& b) {
  return std::memcmp(&a, &b, sizeof a) == 0;
}

/// Compares single-point and batch queries on every target.
template <class Method>
void expect_same_bits_everywhere(const Method& method, const std::vector<Point<Patient>>& points) {
  std::vector<FieldSample> expected(points.size());
  method.sample(points, expected);
  for (const std::int64_t target : test::all_targets()) {
    SCOPED_TRACE(test::target_name(target));
    const test::OnlyTargets only(target);
    std::vector<FieldSample> together(points.size());
    method.sample(points, together);
    for (std::size_t n = 0; n < points.size(); ++n) {
      ASSERT_TRUE(same_bits(together[n], expected[n])) << "point " << n;
      ASSERT_TRUE(same_bits(method.sample(points[n]), expected[n])) << "point " << n << " alone";
    }
  }
}

TEST(LabelMethodTargets, CoverAtLeastTwoTargets) {
  std::string names;
  for (const std::int64_t target : test::all_targets()) names += " " + test::target_name(target);
  std::cout << "SIMD targets tested:" << names << "\n";
  EXPECT_GE(test::all_targets().size(), 2u);
}

TEST(LabelMethodTargets, GiveTheSameBitsForSpheres) {
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  for (const auto& dims : {std::array{40, 22, 13}, std::array{9, 7, 8}, std::array{3, 1, 2}}) {
    for (const int kind : {0, 3}) {
      const GridGeometry grid = test::make_grid(dims, kind);
      const auto labels = internal::random_labels(grid, random);
      const auto points = internal::random_points(grid, 6, 60, random);
      for (const LabelVoxels& voxels : {LabelVoxels(labels, {2, 3}), LabelVoxels(labels, {1, 3, 40000}),
                                        LabelVoxels::mask(*labels, {2, 5})}) {
        expect_same_bits_everywhere(GaussianSphere::make(voxels, 0.9).value(), points);
        for (const double sigma : {0.05, 0.4, 1.1, 2.6}) {
          expect_same_bits_everywhere(SmoothSphere::make(voxels, sigma).value(), points);
        }
      }
    }
  }
}

// Sums of rows within one brick, in several, and across two: a sphere moved by whole voxels together with its
// labels sums the same voxels in the same order.
TEST(LabelMethodTargets, GiveTheSameBitsForAnyBrickBoundary) {
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  GridGeometry small;
  small.dims = {44, 44, 44};
  const Volume<LabelId> labels = internal::random_labels(small, random)->dense();
  // coordinates with few binary digits, so that the fractions are not rounded
  const Point<Patient> centre(21.25, 21.75, 22.375);
  const auto samples_at = [&](int by_i, int by_j, int by_k) {
    GridGeometry grid = small;
    for (int& dim : grid.dims) dim += 17;
    Volume<LabelId> moved(grid);
    for (int k = 0; k < 44; ++k)
      for (int j = 0; j < 44; ++j)
        for (int i = 0; i < 44; ++i) moved.at(i + by_i, j + by_j, k + by_k) = labels.at(i, j, k);
    const auto in_bricks = label_bricks(moved);
    const Point<Patient> at = centre + Vector<Patient>(by_i, by_j, by_k);
    std::vector<FieldSample> samples;
    for (const LabelVoxels& voxels : {LabelVoxels(in_bricks, {2, 3}), LabelVoxels(in_bricks, {1, 3, 40000}),
                                      LabelVoxels::mask(*in_bricks, {2, 5})}) {
      samples.push_back(GaussianSphere::make(voxels, 0.9).value().sample(at));
      for (const double sigma : {0.05, 1.1, 2.6, 5.9})
        samples.push_back(SmoothSphere::make(voxels, sigma).value().sample(at));
    }
    return samples;
  };
  for (const std::int64_t target : test::all_targets()) {
    SCOPED_TRACE(test::target_name(target));
    const test::OnlyTargets only(target);
    const auto expected = samples_at(0, 0, 0);
    for (int by = 1; by <= 16; ++by) {
      for (const auto& moved :
           {samples_at(by, 0, 0), samples_at(0, by, 0), samples_at(0, 0, by), samples_at(by, 17 - by, by)}) {
        for (std::size_t n = 0; n < expected.size(); ++n)
          EXPECT_TRUE(same_bits(moved[n], expected[n])) << "sphere " << n << " moved by " << by;
      }
    }
  }
}

TEST(LabelMethodTargets, GiveTheSameBitsForStoredNormals) {
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  for (const auto& dims : {std::array{12, 9, 7}, std::array{2, 1, 3}}) {
    const GridGeometry grid = test::make_grid(dims, 3);
    Volume<std::uint8_t> ramp(grid);
    for (auto& voxel : ramp.voxels()) voxel = static_cast<std::uint8_t>(random());
    const auto points = internal::random_points(grid, 2, 300, random);
    for (const auto encoding :
         {NormalEncoding::kBytes, NormalEncoding::kOctahedral16, NormalEncoding::kOctahedral24}) {
      expect_same_bits_everywhere(StoredNormals::from_ramp(ramp, encoding), points);
    }
  }
}

/// Hash of 2000 samples in and around a grid of 11 x 10 x 9.
template <class Method>
std::uint64_t hash_of(const Method& method, const GridGeometry& grid) {
  // independent of a library's distributions
  std::mt19937 random(kSeed);
  const auto coordinate = [&] { return static_cast<double>(random()) / 268435456.0 - 3; };
  std::uint64_t hash = kHashSeed;
  for (int n = 0; n < 2000; ++n) {
    const double i = coordinate(), j = coordinate(), k = coordinate();
    const FieldSample sample = method.sample(grid.X_PatientVoxel() * Point<Voxel>(i, j, k));
    for (const double number :
         {sample.value, sample.gradient.x(), sample.gradient.y(), sample.gradient.z()}) {
      hash_double(hash, number);
    }
  }
  return hash_finish(hash);
}

// The hashes change only when a method does. Together with the tests above: bit-identical on every target and
// in every build, which replay of recorded runs relies on.
TEST(LabelMethodTargets, GiveTheSameBitsInEveryBuild) {
  std::mt19937 random(kSeed);
  GridGeometry grid;
  grid.dims = {11, 10, 9};
  grid.spacing_mm = {0.625, 0.75, 0.9};
  grid.direction << 0.6, -0.8, 0, 0.8, 0.6, 0, 0, 0, -1;
  grid.origin = Point<Patient>(-12.5, 40.1, 7.3);
  const LabelVoxels voxels(internal::random_labels(grid, random), {1, 2, 40000});
  EXPECT_EQ(hash_of(GaussianSphere::make(voxels, 1).value(), grid), 8433761418299929925u);
  EXPECT_EQ(hash_of(SmoothSphere::make(voxels, 0.1).value(), grid), 16981201470110792647u);
  EXPECT_EQ(hash_of(SmoothSphere::make(voxels, 1.3).value(), grid), 3806171186135711995u);

  Volume<std::uint16_t> ramp(grid);
  for (auto& voxel : ramp.voxels()) voxel = static_cast<std::uint16_t>(random());
  EXPECT_EQ(hash_of(StoredNormals::from_ramp(ramp, NormalEncoding::kBytes), grid), 1753100619372130700u);
  EXPECT_EQ(hash_of(StoredNormals::from_ramp(ramp, NormalEncoding::kOctahedral16), grid),
            2580366129040539962u);
  EXPECT_EQ(hash_of(StoredNormals::from_ramp(ramp, NormalEncoding::kOctahedral24), grid),
            16027820385605423182u);
}

}  // namespace
}  // namespace palpate
