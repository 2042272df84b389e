#include <gtest/gtest.h>

#include <set>

#include "sampling/label_sphere_test_support.h"

namespace palpate {
namespace {

using test::make_grid;

constexpr unsigned kNormalsSeed = 31;
constexpr std::array kEncodings{NormalEncoding::kBytes, NormalEncoding::kOctahedral16,
                                NormalEncoding::kOctahedral24};

double angle_degrees(const Vector<Patient>& a, const Vector<Patient>& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b)) * 180 / std::numbers::pi;
}

template <class T>
Volume<T> random_ramp(const GridGeometry& grid, std::mt19937& random) {
  Volume<T> ramp(grid);
  // part of the ramp is free space, so that some voxels have no normal
  for (int k = 0; k < grid.dims[2]; ++k) {
    for (int j = 0; j < grid.dims[1]; ++j) {
      for (int i = grid.dims[0] / 2; i < grid.dims[0]; ++i) ramp.at(i, j, k) = static_cast<T>(random());
    }
  }
  return ramp;
}

TEST(StoredNormals, VectorFormEqualsTheLiteralForm) {
  SCOPED_TRACE("seed " + std::to_string(kNormalsSeed));
  std::mt19937 random(kNormalsSeed);
  for (const auto& dims : {std::array{9, 8, 7}, std::array{1, 3, 2}, std::array{1, 1, 1}}) {
    for (int kind = 0; kind < 4; ++kind) {
      const GridGeometry grid = test::make_grid(dims, kind);
      const auto ramp = random_ramp<std::uint16_t>(grid, random);
      const auto points = internal::random_points(grid, 2, 400, random);
      for (const auto encoding : kEncodings) {
        const auto normals = StoredNormals::from_ramp(ramp, encoding);
        for (const auto& p : points) {
          const FieldSample sample = normals.sample(p), literal = normals.sample_literal(p);
          ASSERT_NEAR(sample.value, literal.value, 1e-5);
          // opposite normals may nearly cancel; the remainder has an accurate direction in double only
          ASSERT_LT((sample.gradient - literal.gradient).norm(), 1e-3) << p.eigen().transpose();
        }
      }
    }
  }
}

TEST(StoredNormals, AreWeightedByInverseDistanceAsPublished) {
  // by hand: one corner of the cell is full with a normal along x, the others are empty
  GridGeometry grid;
  grid.dims = {2, 2, 2};
  grid.spacing_mm = {1, 2, 3};
  const Point<Patient> full = grid.X_PatientVoxel() * Point<Voxel>(1, 0, 0);
  for (const auto encoding : kEncodings) {
    const auto normals = StoredNormals::from_field(grid, encoding, [&](const Point<Patient>& p) {
      return (p - full).norm() < 0.1 ? FieldSample{0.6, {-5, 0, 0}} : FieldSample{};
    });
    const Point<Patient> p(0.3, 0.5, 1.2);
    double weights = 0;
    for (const double x : {0.3, 0.7}) {
      for (const double y : {0.5, 1.5}) {
        for (const double z : {1.2, 1.8}) weights += 1 / (std::sqrt(x * x + y * y + z * z) + 0.001);
      }
    }
    const double near = 1 / (std::sqrt(0.7 * 0.7 + 0.5 * 0.5 + 1.2 * 1.2) + 0.001);
    const FieldSample sample = normals.sample(p);
    EXPECT_NEAR(sample.value, 0.6 * near / weights, 1e-6);
    EXPECT_EQ(sample.gradient, Vector<Patient>(-1, 0, 0));
    // at a voxel centre, that voxel
    EXPECT_NEAR(normals.sample(full).value, 0.6, 0.005);
    EXPECT_EQ(normals.voxel(1, 0, 0).value, 0.6);
  }
}

TEST(StoredNormals, PointOutOfARampInThePatientFrameOfAnyGrid) {
  const Vector<Patient> into = Vector<Patient>(0.48, -0.6, 0.64);
  for (int kind = 0; kind < 4; ++kind) {
    const GridGeometry grid = test::make_grid({9, 9, 9}, kind);
    Volume<std::uint16_t> ramp(grid);
    for (int k = 0; k < 9; ++k) {
      for (int j = 0; j < 9; ++j) {
        for (int i = 0; i < 9; ++i) {
          const double along = into.dot(grid.X_PatientVoxel() * Point<Voxel>(i, j, k) - grid.centre());
          ramp.at(i, j, k) = static_cast<std::uint16_t>(std::lround(32768 + 2000 * along));
        }
      }
    }
    for (const auto encoding : kEncodings) {
      const auto normals = StoredNormals::from_ramp(ramp, encoding);
      const double worst = encoding == NormalEncoding::kOctahedral24 ? 0.08 : 0.8;
      EXPECT_LT(angle_degrees(normals.voxel(4, 4, 4).gradient, into), worst);
      const FieldSample sample = normals.sample(grid.X_PatientVoxel() * Point<Voxel>(4.3, 3.6, 4.1));
      EXPECT_LT(angle_degrees(sample.gradient, into), worst);
      EXPECT_NEAR(sample.gradient.norm(), 1, 1e-6);
      EXPECT_NEAR(normals.voxel(4, 4, 4).value, 0.5, 1.0 / 255);
    }
  }
}

TEST(StoredNormals, BytesFlattenASurfaceThatRunsNearlyParallelToAnAxis) {
  // the top of a ball of 100 mm radius, where its normal deviates from the axis by at most 6 degrees
  GridGeometry grid;
  grid.dims = {200, 3, 3};
  grid.spacing_mm = {0.05, 0.5, 0.5};
  grid.origin = Point<Patient>(0, -0.5, 99.5);
  const auto ball = [](const Point<Patient>& p) {
    const Vector<Patient> out = p - Point<Patient>();
    return FieldSample{std::clamp(0.5 + (100 - out.norm()) / 4, 0.0, 1.0), -out.normalized()};
  };
  const auto steps = [&](NormalEncoding encoding) {
    const auto normals = StoredNormals::from_field(grid, encoding, ball);
    std::set<double> tilts;
    for (int i = 0; i < grid.dims[0]; ++i) {
      const Vector<Patient> normal = normals.voxel(i, 1, 1).gradient;
      tilts.insert(std::atan2(normal.x(), normal.z()));
    }
    return tilts.size();
  };
  // 5.7 degrees in steps of 1/127 radian give 14 plateaus; with 24 bits the normal changes at every voxel
  EXPECT_LE(steps(NormalEncoding::kBytes), 15u);
  EXPECT_GE(steps(NormalEncoding::kOctahedral24), 180u);
}

TEST(StoredNormals, ReportTheirStorage) {
  std::mt19937 random(kNormalsSeed);
  const auto ramp = random_ramp<std::uint8_t>(test::make_grid({10, 6, 5}, 1), random);
  const auto occupied =
      std::count_if(ramp.voxels().begin(), ramp.voxels().end(), [](auto v) { return v > 0; });
  for (const auto encoding : kEncodings) {
    const auto normals = StoredNormals::from_ramp(ramp, encoding);
    EXPECT_EQ(normals.bytes_per_voxel(), encoding == NormalEncoding::kOctahedral16 ? 3 : 4);
    EXPECT_EQ(normals.occupied_voxels(), static_cast<std::size_t>(occupied));
    for (int k = 0; k < 5; ++k) {
      for (int j = 0; j < 6; ++j) {
        for (int i = 0; i < 10; ++i) ASSERT_EQ(normals.voxel(i, j, k).value, ramp.at(i, j, k) / 255.0);
      }
    }
  }
}

TEST(StoredNormals, AreZeroInFreeSpaceAndAtNonFinitePositions) {
  const GridGeometry grid = test::make_grid({6, 5, 4}, 2);
  auto points = test::invalid_points(grid);
  points.push_back(grid.X_PatientVoxel() * Point<Voxel>(-1.01, 2, 2));
  points.push_back(grid.X_PatientVoxel() * Point<Voxel>(3, 2, 4.01));
  for (const auto encoding : kEncodings) {
    const auto full = StoredNormals::from_ramp(Volume<std::uint8_t>(grid, 255), encoding);
    const auto empty = StoredNormals::from_ramp(Volume<std::uint8_t>(grid), encoding);
    for (const auto& p : points) {
      for (const FieldSample& sample : {full.sample(p), full.sample_literal(p)}) {
        EXPECT_EQ(sample.value, 0);
        EXPECT_EQ(sample.gradient, Vector<Patient>());
      }
    }
    EXPECT_EQ(empty.occupied_voxels(), 0u);
    EXPECT_EQ(empty.sample(grid.centre()).value, 0);
    EXPECT_EQ(empty.sample(grid.centre()).gradient, Vector<Patient>());
    // in the middle of full voxels there is no direction
    EXPECT_EQ(full.sample(grid.X_PatientVoxel() * Point<Voxel>(2.5, 2, 1.5)).gradient, Vector<Patient>());
  }
}

}  // namespace
}  // namespace palpate
