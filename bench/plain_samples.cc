#include <array>
#include <cstring>

#include "entrant.h"

namespace palpate::bench {

namespace {

double lerp(double a, double b, double t) {
  return a + t * (b - a);
}
double bilerp(const double (&c)[2][2], double v, double w) {
  return lerp(lerp(c[0][0], c[0][1], v), lerp(c[1][0], c[1][1], v), w);
}
int floor_to_int(double x) {
  const int truncated = static_cast<int>(x);
  return truncated - (x < truncated ? 1 : 0);
}

struct Cell {
  explicit Cell(const Eigen::Vector3d& x)
      : i(floor_to_int(x[0])),
        j(floor_to_int(x[1])),
        k(floor_to_int(x[2])),
        u(x[0] - i),
        v(x[1] - j),
        w(x[2] - k) {}
  int i, j, k;
  double u, v, w;
};

FieldSample to_sample(const SampledWork& work, double value, const Eigen::Vector3d& per_voxel) {
  return {value / 255, Vector<Patient>(work.gradient_map * (per_voxel / 255))};
}

/// A single interpolation with its own bounds check.
double trilinear(const Volume<std::uint8_t>& volume, const Eigen::Vector3d& x) {
  const auto& dims = volume.geometry().dims;
  for (int axis = 0; axis < 3; ++axis) {
    if (!(x[axis] >= 0 && x[axis] < dims[axis] - 1)) return 0;
  }
  const Cell c(x);
  const std::uint8_t* p = &volume.at(c.i, c.j, c.k);
  const std::ptrdiff_t row = dims[0], slice = row * dims[1];
  const double corners[2][2] = {
      {lerp(p[0], p[1], c.u), lerp(p[row], p[row + 1], c.u)},
      {lerp(p[slice], p[slice + 1], c.u), lerp(p[slice + row], p[slice + row + 1], c.u)}};
  return bilerp(corners, c.v, c.w);
}

FieldSample seven(const SampledWork& work, const Point<Patient>& p) {
  const Eigen::Vector3d x = (work.X_VoxelPatient * p).eigen();
  Eigen::Vector3d g;
  for (int axis = 0; axis < 3; ++axis) {
    const Eigen::Vector3d h = Eigen::Vector3d::Unit(axis);
    g[axis] = 0.5 * (trilinear(work.bytes, x + h) - trilinear(work.bytes, x - h));
  }
  return to_sample(work, trilinear(work.bytes, x), g);
}

/// All seven interpolations from one neighbourhood of 32 voxels.
FieldSample shared_32(const SampledWork& work, const Point<Patient>& p) {
  const Eigen::Vector3d x = (work.X_VoxelPatient * p).eigen();
  const auto& dims = work.bytes.geometry().dims;
  for (int axis = 0; axis < 3; ++axis) {
    if (!(x[axis] >= 1 && x[axis] < dims[axis] - 2)) return {};
  }
  const Cell c(x);
  const std::uint8_t* const cell = &work.bytes.at(c.i, c.j, c.k);
  const std::ptrdiff_t row = dims[0], slice = row * dims[1];
  const auto along_i = [&](int dj, int dk) {
    const std::uint8_t* r = cell + dj * row + dk * slice;
    return lerp(r[0], r[1], c.u);
  };
  double centre[2][2], before[2][2], after[2][2];
  for (int dk = 0; dk < 2; ++dk) {
    for (int dj = 0; dj < 2; ++dj) {
      const std::uint8_t* r = cell + dj * row + dk * slice;
      before[dk][dj] = lerp(r[-1], r[0], c.u);
      centre[dk][dj] = lerp(r[0], r[1], c.u);
      after[dk][dj] = lerp(r[1], r[2], c.u);
    }
  }
  const double before_j[2][2] = {{along_i(-1, 0), centre[0][0]}, {along_i(-1, 1), centre[1][0]}};
  const double after_j[2][2] = {{centre[0][1], along_i(2, 0)}, {centre[1][1], along_i(2, 1)}};
  const double before_k[2][2] = {{along_i(0, -1), along_i(1, -1)}, {centre[0][0], centre[0][1]}};
  const double after_k[2][2] = {{centre[1][0], centre[1][1]}, {along_i(0, 2), along_i(1, 2)}};
  return to_sample(work, bilerp(centre, c.v, c.w),
                   0.5 * Eigen::Vector3d(bilerp(after, c.v, c.w) - bilerp(before, c.v, c.w),
                                         bilerp(after_j, c.v, c.w) - bilerp(before_j, c.v, c.w),
                                         bilerp(after_k, c.v, c.w) - bilerp(before_k, c.v, c.w)));
}

std::uint32_t load_row(const std::uint8_t* p) {
  std::uint32_t row;
  std::memcpy(&row, p, sizeof(row));
  return row;
}

/// Weights of the cubic B-spline for the four coefficients along an axis, and their derivatives.
struct Weights {
  explicit Weights(double t)
      : p{(1 - t) * (1 - t) * (1 - t) / 6, (3 * t * t * t - 6 * t * t + 4) / 6,
          (-3 * t * t * t + 3 * t * t + 3 * t + 1) / 6, t * t * t / 6},
        q{-(1 - t) * (1 - t) / 2, (3 * t * t - 4 * t) / 2, (-3 * t * t + 2 * t + 1) / 2, t * t / 2} {}
  double p[4], q[4];
};

/// Cell of a spline sample, and the conversion of its sums to a FieldSample.
struct SplineCell {
  SplineCell(const SplineField& field, const Point<Patient>& point)
      : SplineCell(std::get_if<Bricks<std::int16_t>>(&field.coefficients())->view(),
                   Cell((field.X_VoxelPatient() * point).eigen())) {}
  SplineCell(const BrickView<std::int16_t>& c, const Cell& cell)
      : first(c.cell(cell.i, cell.j, cell.k) - (1 + row + slice)), i(cell.u), j(cell.v), k(cell.w) {}
  static constexpr std::ptrdiff_t row = BrickLayout::kRow, slice = BrickLayout::kSlice;
  const std::int16_t* first;
  Weights i, j, k;
};

FieldSample to_sample(const SplineField& field, double value, const Eigen::Vector3d& per_voxel) {
  return {field.outside() + field.scale() * value,
          Vector<Patient>(field.X_VoxelPatient().linear().transpose() * (field.scale() * per_voxel))};
}

/// Direct formula: 64 terms, each with a product of three weights for the value and for each derivative.
FieldSample sum_of_64(const SplineField& field, const Point<Patient>& point) {
  const SplineCell cell(field, point);
  double value = 0, gi = 0, gj = 0, gk = 0;
  for (int e = 0; e < 4; ++e) {
    for (int b = 0; b < 4; ++b) {
      for (int a = 0; a < 4; ++a) {
        const double c = cell.first[a + b * cell.row + e * cell.slice];
        value += c * (cell.i.p[a] * cell.j.p[b] * cell.k.p[e]);
        gi += c * (cell.i.q[a] * cell.j.p[b] * cell.k.p[e]);
        gj += c * (cell.i.p[a] * cell.j.q[b] * cell.k.p[e]);
        gk += c * (cell.i.p[a] * cell.j.p[b] * cell.k.q[e]);
      }
    }
  }
  return to_sample(field, value, {gi, gj, gk});
}

/// Separable evaluation, one axis after the other.
FieldSample separable_sum(const SplineField& field, const Point<Patient>& point) {
  const SplineCell cell(field, point);
  double value = 0, gi = 0, gj = 0, gk = 0;
  for (int e = 0; e < 4; ++e) {
    double plane = 0, plane_i = 0, plane_j = 0;
    for (int b = 0; b < 4; ++b) {
      const std::int16_t* s = cell.first + b * cell.row + e * cell.slice;
      const auto &p = cell.i.p, &q = cell.i.q;
      const double line = s[0] * p[0] + s[1] * p[1] + s[2] * p[2] + s[3] * p[3];
      const double line_i = s[0] * q[0] + s[1] * q[1] + s[2] * q[2] + s[3] * q[3];
      plane += cell.j.p[b] * line;
      plane_i += cell.j.p[b] * line_i;
      plane_j += cell.j.q[b] * line;
    }
    value += cell.k.p[e] * plane;
    gi += cell.k.p[e] * plane_i;
    gj += cell.k.p[e] * plane_j;
    gk += cell.k.q[e] * plane;
  }
  return to_sample(field, value, {gi, gj, gk});
}

}  // namespace

std::vector<Entrant> plain_entrants(const std::shared_ptr<const SampledWork>& work) {
  return {
      entrant("seven plain samples", [work](const Point<Patient>& p) { return seven(*work, p); }),
      entrant("shared 32 voxels, scalar", [work](const Point<Patient>& p) { return shared_32(*work, p); })};
}

Entrant loads_only(const std::shared_ptr<const SampledWork>& work) {
  return entrant(
      "the loads alone",
      [work](const Point<Patient>& p) {
        const Eigen::Vector3d x = (work->X_VoxelPatient * p).eigen();
        const auto& dims = work->bytes.geometry().dims;
        const std::ptrdiff_t row = dims[0], slice = row * dims[1];
        const std::uint8_t* const cell = work->bytes.voxels().data() + static_cast<int>(x[0]) - 1 +
                                         static_cast<int>(x[1]) * row + static_cast<int>(x[2]) * slice;
        std::uint32_t all = 0;
        for (int dj = 0; dj < 2; ++dj)
          all ^= load_row(cell + dj * row - slice) ^ load_row(cell + dj * row + 2 * slice);
        for (int dk = 0; dk < 2; ++dk) {
          for (int dj = -1; dj < 3; ++dj) all ^= load_row(cell + dj * row + dk * slice);
        }
        return FieldSample{static_cast<double>(static_cast<std::int32_t>(all)), {}};
      },
      Compared::kNothing);
}

std::vector<Entrant> plain_splines(const SplineField& field) {
  return {entrant("plain sum of 64", [&field](const Point<Patient>& p) { return sum_of_64(field, p); }),
          entrant("axis after axis, scalar",
                  [&field](const Point<Patient>& p) { return separable_sum(field, p); })};
}

}  // namespace palpate::bench
