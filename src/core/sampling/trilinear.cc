#include "palpate/sampling/sampling.h"

namespace palpate {

namespace {

/// Floor of a number in the range of int; std::floor is a library call on baseline x86-64.
int floor_to_int(double x) {
  const int truncated = static_cast<int>(x);
  return truncated - (x < truncated ? 1 : 0);
}

/// Whether x is less than one voxel beyond the outermost centres on every axis; false for NaN.
bool within_reach(const Eigen::Vector3d& x, const std::array<int, 3>& dims) {
  for (int axis = 0; axis < 3; ++axis) {
    if (!(x[axis] > -1 && x[axis] < dims[axis])) return false;
  }
  return true;
}

double lerp(double a, double b, double t) {
  return a + t * (b - a);
}

template <class T>
double sample(const Bricks<T>& voxels, const internal::SamplingMap& map, const Point<Patient>& p) {
  const Eigen::Vector3d x = (map.X_VoxelPatient * p).eigen();
  if (!within_reach(x, voxels.geometry().dims)) return map.outside;
  const int i = floor_to_int(x[0]), j = floor_to_int(x[1]), k = floor_to_int(x[2]);
  const double u = x[0] - i, v = x[1] - j, w = x[2] - k;
  constexpr std::ptrdiff_t row = BrickLayout::kRow, slice = BrickLayout::kSlice;
  const T* const cell = voxels.view().cell(i, j, k);
  const auto along_i = [&](std::ptrdiff_t at) { return lerp(cell[at], cell[at + 1], u); };
  const double below = lerp(along_i(0), along_i(row), v);
  const double above = lerp(along_i(slice), along_i(slice + row), v);
  return map.sample_columns[4][0] + map.sample_columns[3][0] * lerp(below, above, w);
}

}  // namespace

double sample_value(const Field& field, const Point<Patient>& x) {
  return std::visit([&](const auto& voxels) { return sample(voxels, field.map(), x); }, field.bricks());
}

double sample_value(const SignedField& field, const Point<Patient>& x) {
  return sample(field.bricks(), field.map(), x);
}

}  // namespace palpate
