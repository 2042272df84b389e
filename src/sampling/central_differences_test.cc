#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "palpate/sampling.h"

namespace palpate {
namespace {

// ---- the oracle: the definition, literally, in double -------------------------------------------

template <class T>
double oracle_trilinear(const Volume<T>& volume, const Eigen::Vector3d& x) {
  const Eigen::Vector3d base = x.array().floor();
  double sum = 0;
  for (int corner = 0; corner < 8; ++corner) {
    double weight = 1;
    Eigen::Vector3d at;
    for (int axis = 0; axis < 3; ++axis) {
      const int bit = (corner >> axis) & 1;
      at[axis] = base[axis] + bit;
      weight *= bit == 1 ? x[axis] - base[axis] : 1 - (x[axis] - base[axis]);
    }
    const auto index = [&](int axis) { return static_cast<int>(at[axis]); };
    sum += weight * volume.at_or(index(0), index(1), index(2), T{0});
  }
  return sum / std::numeric_limits<T>::max();
}

template <class T>
FieldSample oracle_sample(const Volume<T>& volume, const Point<Patient>& p) {
  const Eigen::Matrix3d L = volume.geometry().X_PatientVoxel().linear();
  const Eigen::Vector3d x = L.fullPivLu().solve(p.eigen() - volume.geometry().origin.eigen());
  Eigen::Vector3d per_voxel;
  for (int axis = 0; axis < 3; ++axis) {
    const Eigen::Vector3d h = Eigen::Vector3d::Unit(axis);
    per_voxel[axis] = (oracle_trilinear(volume, x + h) - oracle_trilinear(volume, x - h)) / 2;
  }
  // L^T g_mm = g_voxel
  return {oracle_trilinear(volume, x), Vector<Patient>(L.transpose().fullPivLu().solve(per_voxel))};
}

// ---- grids and points ----------------------------------------------------------------------------

GridGeometry make_grid(std::array<int, 3> dims, int kind) {
  GridGeometry grid;
  grid.dims = dims;
  grid.origin = Point<Patient>(-12.5, 40, 7.25);
  if (kind >= 1) grid.spacing_mm = {0.28, 0.625, 1.0};
  if (kind >= 2) {
    grid.direction = Eigen::AngleAxisd(0.7, Eigen::Vector3d(-1, 2, 0.5).normalized()).toRotationMatrix();
  }
  if (kind >= 3) grid.direction.col(0) *= -1;
  return grid;
}

template <class T>
Volume<T> random_volume(const GridGeometry& grid, std::mt19937& random) {
  Volume<T> volume(grid);
  std::uniform_int_distribution<int> level(0, std::numeric_limits<T>::max());
  for (T& voxel : volume.voxels()) voxel = static_cast<T>(level(random));
  return volume;
}

template <class T>
void expect_oracle(const Volume<T>& volume, const Field& field, const Eigen::Vector3d& voxel) {
  const Point<Patient> p = volume.geometry().X_PatientVoxel() * Point<Voxel>(voxel);
  const FieldSample expected = oracle_sample(volume, p);
  const FieldSample sample = sample_central_differences(field, p);
  EXPECT_NEAR(sample.value, expected.value, 1e-12) << "at voxel " << voxel.transpose();
  EXPECT_LT((sample.gradient - expected.gradient).norm(), 1e-11) << "at voxel " << voxel.transpose();
  EXPECT_NEAR(sample_value(field, p), expected.value, 1e-12) << "at voxel " << voxel.transpose();
}

template <class T>
class CentralDifferences : public testing::Test {};
using Storages = testing::Types<std::uint8_t, std::uint16_t>;
TYPED_TEST_SUITE(CentralDifferences, Storages);

TYPED_TEST(CentralDifferences, EqualSevenTrilinearInterpolationsAnywhere) {
  const auto seed = std::random_device{}();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  for (const auto& dims : {std::array{9, 7, 8}, std::array{4, 4, 4}, std::array{2, 3, 2}, std::array{1, 6, 1},
                           std::array{5, 1, 3}, std::array{1, 1, 1}}) {
    for (int kind = 0; kind < 4; ++kind) {
      const auto volume = random_volume<TypeParam>(make_grid(dims, kind), random);
      const Field field(volume);
      for (int n = 0; n < 400; ++n) {
        Eigen::Vector3d voxel;
        for (int axis = 0; axis < 3; ++axis) {
          voxel[axis] = std::uniform_real_distribution<double>(-3.5, dims[axis] + 2.5)(random);
        }
        expect_oracle(volume, field, voxel);
      }
    }
  }
}

TYPED_TEST(CentralDifferences, EqualTheOracleOnEveryFaceEdgeAndCorner) {
  // the interpolant has kinks in its gradient at whole numbers, none in its value or differences, so
  // that every combination of border coordinates may be asked for
  const auto seed = std::random_device{}();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  const auto volume = random_volume<TypeParam>(make_grid({5, 6, 4}, 0), random);
  const Field field(volume);
  const auto border = [](int n) {
    return std::array{-2.0,    -1.5,    -1.0,    -0.25,   0.0,      0.5,     1.0,     n - 3.0,
                      n - 2.5, n - 2.0, n - 1.5, n - 1.0, n - 0.75, n + 0.0, n + 0.5, n + 1.0};
  };
  for (const double z : border(4)) {
    for (const double y : border(6)) {
      for (const double x : border(5)) expect_oracle(volume, field, {x, y, z});
    }
  }
}

TYPED_TEST(CentralDifferences, AreHalfTheDifferenceOfNeighboursAtVoxelCentres) {
  std::mt19937 random(3);
  const auto volume = random_volume<TypeParam>(make_grid({6, 6, 6}, 0), random);
  const Field field(volume);
  const double full = std::numeric_limits<TypeParam>::max();
  const Point<Patient> p = volume.geometry().X_PatientVoxel() * Point<Voxel>(2, 3, 4);
  const FieldSample sample = sample_central_differences(field, p);
  EXPECT_DOUBLE_EQ(sample.value, volume.at(2, 3, 4) / full);
  EXPECT_NEAR(sample.gradient.x(), (volume.at(3, 3, 4) - volume.at(1, 3, 4)) / (2 * full), 1e-14);
  EXPECT_NEAR(sample.gradient.y(), (volume.at(2, 4, 4) - volume.at(2, 2, 4)) / (2 * full), 1e-14);
  EXPECT_NEAR(sample.gradient.z(), (volume.at(2, 3, 5) - volume.at(2, 3, 3)) / (2 * full), 1e-14);
}

TYPED_TEST(CentralDifferences, AreExactOnALinearFieldOfAnyGrid) {
  // f = (40 + 3 i + 5 j + 7 k) / full scale
  for (int kind = 0; kind < 4; ++kind) {
    const GridGeometry grid = make_grid({7, 7, 7}, kind);
    Volume<TypeParam> volume(grid);
    for (int k = 0; k < 7; ++k) {
      for (int j = 0; j < 7; ++j) {
        for (int i = 0; i < 7; ++i) volume.at(i, j, k) = static_cast<TypeParam>(40 + 3 * i + 5 * j + 7 * k);
      }
    }
    const Field field(volume);
    const double full = std::numeric_limits<TypeParam>::max();
    const Point<Patient> p = grid.X_PatientVoxel() * Point<Voxel>(2.3, 4.1, 1.7);
    const FieldSample sample = sample_central_differences(field, p);
    EXPECT_NEAR(sample.value, (40 + 3 * 2.3 + 5 * 4.1 + 7 * 1.7) / full, 1e-12);

    // along each grid axis the value changes by the gradient's component per mm
    const Eigen::Vector3d along = grid.direction.transpose() * sample.gradient.eigen();
    EXPECT_NEAR(along[0], 3 / full / grid.spacing_mm[0], 1e-12);
    EXPECT_NEAR(along[1], 5 / full / grid.spacing_mm[1], 1e-12);
    EXPECT_NEAR(along[2], 7 / full / grid.spacing_mm[2], 1e-12);
  }
}

TYPED_TEST(CentralDifferences, FallToZeroLinearlyOverOneVoxelOutside) {
  const GridGeometry grid = make_grid({4, 4, 4}, 1);
  const Field field(Volume<TypeParam>(grid, std::numeric_limits<TypeParam>::max()));
  const auto value = [&](double i) {
    return sample_value(field, grid.X_PatientVoxel() * Point<Voxel>(i, 1.5, 1.5));
  };
  EXPECT_NEAR(value(0), 1, 1e-12);
  EXPECT_NEAR(value(-0.25), 0.75, 1e-12);
  EXPECT_NEAR(value(-0.75), 0.25, 1e-12);
  EXPECT_NEAR(value(3.75), 0.25, 1e-12);
  EXPECT_EQ(value(-1.25), 0);
  EXPECT_EQ(value(4.25), 0);
  // and the gradient there points into the volume
  const auto sample = sample_central_differences(field, grid.X_PatientVoxel() * Point<Voxel>(-0.5, 1.5, 1.5));
  EXPECT_GT(sample.gradient.dot(Vector<Patient>(grid.direction.col(0))), 0);
}

TYPED_TEST(CentralDifferences, AreZeroForWhatIsNoPlace) {
  const Field field(Volume<TypeParam>(make_grid({4, 4, 4}, 2), std::numeric_limits<TypeParam>::max()));
  const double nan = std::numeric_limits<double>::quiet_NaN(), inf = std::numeric_limits<double>::infinity();
  for (const double bad : {nan, inf, -inf, 1e300, -1e300, 1e12, -1e12, 3e9, -3e9}) {
    for (int axis = 0; axis < 3; ++axis) {
      Point<Patient> p = field.geometry().centre();
      p[axis] = bad;
      const FieldSample sample = sample_central_differences(field, p);
      EXPECT_EQ(sample.value, 0) << bad;
      EXPECT_EQ(sample.gradient, Vector<Patient>()) << bad;
      EXPECT_EQ(sample_value(field, p), 0) << bad;
    }
  }
}

}  // namespace
}  // namespace palpate
