#include <limits>

#include "palpate/sampling.h"

// The founding sample wants seven trilinear interpolations: at x, and at x +- 1 voxel along i, j, k. All
// of them share the fraction (u, v, w) of x in its cell, because whole voxels lie between them. Hence the
// 7 x 8 corners are only 32 different voxels, and every interpolation along i is needed once:
//
//     along i   16 voxels   4 rows (the cell's own), from i-1 to i+2
//     along j    8 voxels   4 rows at j-1 and j+2, from i to i+1
//     along k    8 voxels   4 rows at k-1 and k+2, from i to i+1
//
// Everything is computed in units of one stored step and scaled at the end.
namespace palpate {

namespace {

/// The voxel whose centre lies at or just below a point on every axis, and the fraction beyond it.
struct Cell {
  int i, j, k;
  double u, v, w;
};

/// Floor of a number that fits an int; std::floor is a library call on baseline x86-64.
int floor_to_int(double x) {
  const int truncated = static_cast<int>(x);
  return truncated - (x < truncated ? 1 : 0);
}

Cell cell_of(const Eigen::Vector3d& x) {
  const int i = floor_to_int(x[0]), j = floor_to_int(x[1]), k = floor_to_int(x[2]);
  return {i, j, k, x[0] - i, x[1] - j, x[2] - k};
}

/// Less than `reach` voxels beyond the outermost centres on every axis. False for NaN.
bool within_reach(const Eigen::Vector3d& x, const std::array<int, 3>& dims, double reach) {
  for (int axis = 0; axis < 3; ++axis) {
    if (!(x[axis] > -reach && x[axis] < dims[axis] - 1 + reach)) return false;
  }
  return true;
}

/// All voxels from `margin` before the cell to `margin` after it lie inside the grid.
bool inside(const Cell& c, const std::array<int, 3>& dims, int margin) {
  return c.i >= margin && c.j >= margin && c.k >= margin && c.i + margin + 1 < dims[0] &&
         c.j + margin + 1 < dims[1] && c.k + margin + 1 < dims[2];
}

double lerp(double a, double b, double t) {
  return a + t * (b - a);
}

double bilerp(const double (&c)[2][2], double v, double w) {
  return lerp(lerp(c[0][0], c[0][1], v), lerp(c[1][0], c[1][1], v), w);
}

/// Reads voxels near a cell without asking whether they exist.
template <class T>
struct InsideReader {
  const T* cell;
  std::ptrdiff_t row, slice;
  double operator()(int di, int dj, int dk) const { return cell[di + dj * row + dk * slice]; }
};

/// Reads voxels near a cell, 0 beyond the grid.
template <class T>
struct BorderReader {
  const Volume<T>& volume;
  const Cell& cell;
  double operator()(int di, int dj, int dk) const {
    return volume.at_or(cell.i + di, cell.j + dj, cell.k + dk, T{0});
  }
};

template <class T>
InsideReader<T> inside_reader(const Volume<T>& volume, const Cell& c) {
  const GridGeometry& grid = volume.geometry();
  const auto row = static_cast<std::ptrdiff_t>(grid.dims[0]);
  return {volume.voxels().data() + grid.offset(c.i, c.j, c.k), row, row * grid.dims[1]};
}

template <class Reader>
double value_at(const Reader& read, const Cell& c) {
  double along_i[2][2];
  for (int dk = 0; dk < 2; ++dk) {
    for (int dj = 0; dj < 2; ++dj) along_i[dk][dj] = lerp(read(0, dj, dk), read(1, dj, dk), c.u);
  }
  return bilerp(along_i, c.v, c.w);
}

struct RawSample {
  double value;
  Eigen::Vector3d gradient_per_voxel;
};

template <class Reader>
RawSample sample_at(const Reader& read, const Cell& c) {
  const auto along_i = [&](int dj, int dk) { return lerp(read(0, dj, dk), read(1, dj, dk), c.u); };

  // the cell's own rows give the value and the difference along i
  double centre[2][2], before[2][2], after[2][2];
  for (int dk = 0; dk < 2; ++dk) {
    for (int dj = 0; dj < 2; ++dj) {
      const double a = read(-1, dj, dk), b = read(0, dj, dk), e = read(1, dj, dk), f = read(2, dj, dk);
      before[dk][dj] = lerp(a, b, c.u);
      centre[dk][dj] = lerp(b, e, c.u);
      after[dk][dj] = lerp(e, f, c.u);
    }
  }
  const double gi = 0.5 * (bilerp(after, c.v, c.w) - bilerp(before, c.v, c.w));

  // the rows beside them, shifted by one voxel each way
  const double before_j[2][2] = {{along_i(-1, 0), centre[0][0]}, {along_i(-1, 1), centre[1][0]}};
  const double after_j[2][2] = {{centre[0][1], along_i(2, 0)}, {centre[1][1], along_i(2, 1)}};
  const double gj = 0.5 * (bilerp(after_j, c.v, c.w) - bilerp(before_j, c.v, c.w));

  const double before_k[2][2] = {{along_i(0, -1), along_i(1, -1)}, {centre[0][0], centre[0][1]}};
  const double after_k[2][2] = {{centre[1][0], centre[1][1]}, {along_i(0, 2), along_i(1, 2)}};
  const double gk = 0.5 * (bilerp(after_k, c.v, c.w) - bilerp(before_k, c.v, c.w));

  return {bilerp(centre, c.v, c.w), {gi, gj, gk}};
}

template <class T>
constexpr double kFullScale = std::numeric_limits<T>::max();

template <class T>
double sample_value_of(const Volume<T>& volume, const Eigen::Vector3d& x) {
  const auto& dims = volume.geometry().dims;
  if (!within_reach(x, dims, 1)) return 0;
  const Cell c = cell_of(x);
  const double raw =
      inside(c, dims, 0) ? value_at(inside_reader(volume, c), c) : value_at(BorderReader<T>{volume, c}, c);
  return raw / kFullScale<T>;
}

template <class T>
FieldSample sample_of(const Volume<T>& volume, const Eigen::Vector3d& x,
                      const Eigen::Matrix3d& gradient_map) {
  const auto& dims = volume.geometry().dims;
  if (!within_reach(x, dims, 2)) return {};
  const Cell c = cell_of(x);
  const RawSample raw =
      inside(c, dims, 1) ? sample_at(inside_reader(volume, c), c) : sample_at(BorderReader<T>{volume, c}, c);
  return {raw.value / kFullScale<T>,
          Vector<Patient>(gradient_map * (raw.gradient_per_voxel / kFullScale<T>))};
}

}  // namespace

double sample_value(const Field& field, const Point<Patient>& x) {
  const Eigen::Vector3d voxel = (field.X_VoxelPatient() * x).eigen();
  return std::visit([&](const auto& volume) { return sample_value_of(volume, voxel); }, field.storage());
}

FieldSample sample_central_differences(const Field& field, const Point<Patient>& x) {
  const Eigen::Vector3d voxel = (field.X_VoxelPatient() * x).eigen();
  return std::visit([&](const auto& volume) { return sample_of(volume, voxel, field.gradient_map()); },
                    field.storage());
}

}  // namespace palpate
