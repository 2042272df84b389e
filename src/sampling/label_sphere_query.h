#pragma once

#include <algorithm>
#include <array>

#include "sampling/label_sphere_simd.h"

namespace palpate::internal::label_sphere {

/// Takes points to voxels, samples the sphere there, and takes the gradients back to millimetres, a few
/// points at a time so that nothing is allocated.
template <class Kernel>
void sample_sphere_at(const LabelVoxels& voxels, const Kernel& kernel, std::span<const Point<Patient>> points,
                      std::span<FieldSample> samples) {
  PALPATE_CHECK(points.size() == samples.size());
  const auto& dims = voxels.geometry().dims;
  const Eigen::Matrix3d& voxel_per_mm = voxels.X_VoxelPatient().linear();
  std::visit(
      [&](const auto& volume) {
        const LabelGrid<typename std::decay_t<decltype(volume->voxels())>::value_type> grid{
            volume->voxels().data(),
            {dims[0], dims[1], dims[2]},
            voxels.ranges().data(),
            voxels.ranges().size()};
        constexpr std::size_t kChunk = 32;
        std::array<SpherePoint, kChunk> in_voxels;
        std::array<SphereSample, kChunk> found;
        for (std::size_t first = 0; first < points.size(); first += kChunk) {
          const std::size_t count = std::min(kChunk, points.size() - first);
          for (std::size_t n = 0; n < count; ++n) {
            const Point<Voxel> x = voxels.X_VoxelPatient() * points[first + n];
            in_voxels[n] = {{x.x(), x.y(), x.z()}};
          }
          sample_sphere(grid, kernel, in_voxels.data(), count, found.data());
          for (std::size_t n = 0; n < count; ++n) {
            samples[first + n] = {found[n].value, Vector<Patient>(voxel_per_mm.transpose() *
                                                                  Eigen::Vector3d(found[n].gradient))};
          }
        }
      },
      voxels.storage());
}

}  // namespace palpate::internal::label_sphere
