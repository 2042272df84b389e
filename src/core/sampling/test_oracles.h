#pragma once

#include <cmath>
#include <random>
#include <vector>

#include "palpate/sampling/sampling.h"
#include "sampling/test_targets.h"

/// Definitions of the methods, literally and in double, and helpers of the tests of sampling.
namespace palpate::test {

inline constexpr std::uint32_t kSeed = 20261120;

/// Voxel values of a volume, `outside` beyond the grid.
struct Values {
  Volume<double> volume;
  double outside = 0;
  double operator()(int i, int j, int k) const { return volume.at_or(i, j, k, outside); }
};

template <class T>
Values values_of(const Volume<T>& stored, double scale, double offset, double outside) {
  Values values{Volume<double>(stored.geometry()), outside};
  for (std::size_t n = 0; n < stored.voxels().size(); ++n) {
    values.volume.voxels()[n] = offset + scale * stored.voxels()[n];
  }
  return values;
}

/// Weighted sum of the eight corner values.
inline double trilinear(const Values& values, const Eigen::Vector3d& x) {
  if (!(x.array().abs() < 1e6).all()) return values.outside;
  const Eigen::Vector3d base = x.array().floor();
  double sum = 0;
  for (int corner = 0; corner < 8; ++corner) {
    double weight = 1;
    std::array<int, 3> at;
    for (int axis = 0; axis < 3; ++axis) {
      const int bit = (corner >> axis) & 1;
      at[axis] = static_cast<int>(base[axis]) + bit;
      weight *= bit == 1 ? x[axis] - base[axis] : 1 - (x[axis] - base[axis]);
    }
    sum += weight * values(at[0], at[1], at[2]);
  }
  return sum;
}

/// Transforms between voxels and the patient, computed independently of the code under test.
struct GridMaps {
  explicit GridMaps(const GridGeometry& grid)
      : origin(grid.origin.eigen()),
        voxel_per_mm(grid.X_PatientVoxel().linear().fullPivLu().inverse()),
        gradient_per_mm(grid.X_PatientVoxel().linear().transpose().fullPivLu().inverse()) {}
  Eigen::Vector3d to_voxel(const Point<Patient>& p) const { return voxel_per_mm * (p.eigen() - origin); }
  /// Gradient per mm from a gradient per voxel: L^T g_mm = g_voxel.
  Vector<Patient> per_mm(const Eigen::Vector3d& g) const { return Vector<Patient>(gradient_per_mm * g); }

  Eigen::Vector3d origin;
  Eigen::Matrix3d voxel_per_mm, gradient_per_mm;
};

/// Reference for central differences: seven trilinear interpolations.
class SevenTrilinear {
 public:
  explicit SevenTrilinear(Values values) : values_(std::move(values)), maps_(values_.volume.geometry()) {}
  FieldSample operator()(const Point<Patient>& p) const {
    const Eigen::Vector3d x = maps_.to_voxel(p);
    Eigen::Vector3d per_voxel;
    for (int axis = 0; axis < 3; ++axis) {
      const Eigen::Vector3d h = Eigen::Vector3d::Unit(axis);
      per_voxel[axis] = (trilinear(values_, x + h) - trilinear(values_, x - h)) / 2;
    }
    return {trilinear(values_, x), maps_.per_mm(per_voxel)};
  }

 private:
  Values values_;
  GridMaps maps_;
};

/// Cubic B-spline and its derivative at a distance from its centre.
inline double b_spline(double t) {
  t = std::abs(t);
  if (t < 1) return 2.0 / 3 - t * t + t * t * t / 2;
  return t < 2 ? (2 - t) * (2 - t) * (2 - t) / 6 : 0;
}
inline double b_spline_slope(double t) {
  const double sign = t < 0 ? -1 : 1;
  t = std::abs(t);
  if (t < 1) return sign * (-2 * t + 1.5 * t * t);
  return t < 2 ? -sign * (2 - t) * (2 - t) / 2 : 0;
}

/// Reference for the spline: direct sum over 64 B-splines. Coefficients are continued oddly about one voxel
/// beyond the grid; the value there and beyond is `outside`.
class SumOf64 {
 public:
  SumOf64(Values coefficients, double outside)
      : c_(std::move(coefficients)), maps_(c_.volume.geometry()), outside_(outside) {}

  FieldSample operator()(const Point<Patient>& p) const {
    const auto& dims = c_.volume.geometry().dims;
    const Eigen::Vector3d x = maps_.to_voxel(p);
    FieldSample sample{outside_, {}};
    for (int axis = 0; axis < 3; ++axis) {
      if (!(x[axis] > -1 && x[axis] < dims[axis])) return sample;
    }
    Eigen::Vector3d per_voxel = Eigen::Vector3d::Zero();
    for (int term = 0; term < 64; ++term) {
      const std::array<int, 3> step{term % 4 - 1, term / 4 % 4 - 1, term / 16 - 1};
      std::array<int, 3> index;
      Eigen::Vector3d b, slope;
      for (int axis = 0; axis < 3; ++axis) {
        index[axis] = static_cast<int>(std::floor(x[axis])) + step[axis];
        b[axis] = b_spline(x[axis] - index[axis]);
        slope[axis] = b_spline_slope(x[axis] - index[axis]);
      }
      const double c = coefficient(index);
      sample.value += c * b.prod();
      per_voxel +=
          c * Eigen::Vector3d(slope[0] * b[1] * b[2], b[0] * slope[1] * b[2], b[0] * b[1] * slope[2]);
    }
    sample.gradient = maps_.per_mm(per_voxel);
    return sample;
  }

 private:
  double coefficient(std::array<int, 3> index) const {
    double sign = 1;
    for (int axis = 0; axis < 3; ++axis) {
      const int n = c_.volume.geometry().dims[axis];
      const int mirrored = index[axis] < -1  ? -2 - index[axis]
                           : index[axis] > n ? 2 * n - index[axis]
                                             : index[axis];
      if (mirrored != index[axis]) sign = -sign;
      index[axis] = mirrored;
    }
    return sign * c_(index[0], index[1], index[2]);
  }

  Values c_;
  GridMaps maps_;
  double outside_;
};

template <class T>
Volume<T> random_volume(const GridGeometry& grid, std::mt19937& random) {
  Volume<T> volume(grid);
  std::uniform_int_distribution<int> level(std::numeric_limits<T>::min(), std::numeric_limits<T>::max());
  for (T& voxel : volume.voxels()) voxel = static_cast<T>(level(random));
  return volume;
}

/// Random point within `margin` voxels of the grid.
inline Point<Patient> random_point(const GridGeometry& grid, double margin, std::mt19937& random) {
  Eigen::Vector3d voxel;
  for (int axis = 0; axis < 3; ++axis) {
    voxel[axis] = std::uniform_real_distribution<double>(-margin, grid.dims[axis] - 1 + margin)(random);
  }
  return grid.X_PatientVoxel() * Point<Voxel>(voxel);
}

/// Every combination of coordinates at and near the borders, at voxel centres and halfway between.
inline std::vector<Point<Patient>> border_points(const GridGeometry& grid) {
  const auto border = [&](int axis) {
    const double n = grid.dims[axis];
    return std::array{-2.0,    -1.5,    -1.0,    -0.25,   0.0,      0.5,     1.0,     n - 3.0,
                      n - 2.5, n - 2.0, n - 1.5, n - 1.0, n - 0.75, n + 0.0, n + 0.5, n + 1.0};
  };
  std::vector<Point<Patient>> points;
  for (const double z : border(2)) {
    for (const double y : border(1)) {
      for (const double x : border(0)) points.push_back(grid.X_PatientVoxel() * Point<Voxel>(x, y, z));
    }
  }
  return points;
}

}  // namespace palpate::test
