#include "verification/bare_force.h"

#include <array>
#include <cmath>
#include <limits>

namespace palpate {
namespace {

// a smaller gradient is rounding error without a direction, as for the force methods
constexpr double kFlat_per_mm = 1e-6;

// trilinear interpolation at a point in voxel coordinates; 0 outside
template <class T>
double value_at(const Bricks<T>& voxels, const Eigen::Vector3d& position) {
  std::array<int, 3> first{};
  std::array<double, 3> part{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double at = position[static_cast<Eigen::Index>(axis)];
    if (!(at > -1 && at < voxels.geometry().dims[axis])) return 0;
    first[axis] = static_cast<int>(std::floor(at));
    part[axis] = at - first[axis];
  }
  const T* const cell = voxels.view().cell(first[0], first[1], first[2]);
  double value = 0;
  for (int k = 0; k < 2; ++k)
    for (int j = 0; j < 2; ++j)
      for (int i = 0; i < 2; ++i)
        value += (i ? part[0] : 1 - part[0]) * (j ? part[1] : 1 - part[1]) * (k ? part[2] : 1 - part[2]) *
                 cell[i + j * BrickLayout::kRow + k * BrickLayout::kSlice];
  return value / std::numeric_limits<T>::max();
}

template <class T>
Vector<Patient> force_at(const Field& field, const Bricks<T>& voxels, double full_force_N,
                         const Point<Patient>& tip) {
  const Eigen::Vector3d position = (field.X_VoxelPatient() * tip).eigen();
  Eigen::Vector3d slope;
  for (int axis = 0; axis < 3; ++axis) {
    const Eigen::Vector3d step = Eigen::Vector3d::Unit(axis);
    slope[axis] = 0.5 * (value_at(voxels, position + step) - value_at(voxels, position - step));
  }
  const Eigen::Vector3d gradient = field.gradient_map() * slope;
  const double length = gradient.norm();
  if (!(length > kFlat_per_mm)) return {};
  return Vector<Patient>(gradient * (-full_force_N * value_at(voxels, position) / length));
}

}  // namespace

Vector<Patient> bare_force_N(const Field& field, double full_force_N, const Point<Patient>& tip) {
  return std::visit([&](const auto& voxels) { return force_at(field, voxels, full_force_N, tip); },
                    field.bricks());
}

}  // namespace palpate
