#pragma once

#include <algorithm>
#include <array>
#include <type_traits>

#include "sampling/label_sphere_simd.h"

namespace palpate::internal::label_sphere {

/// Samples a sphere filter. Kernels that need voxel coordinates are called in chunks, so that nothing is
/// allocated.
template <class Kernel>
void sample_sphere_at(const LabelVoxels& voxels, const Kernel& kernel, std::span<const Point<Patient>> points,
                      std::span<FieldSample> samples) {
  PALPATE_CHECK(points.size() == samples.size());
  const auto& dims = voxels.geometry().dims;
  std::visit(
      [&]<class T>(const std::shared_ptr<const Bricks<T>>& bricks) {
        const LabelGrid<T> grid{bricks->view(),
                                {dims[0], dims[1], dims[2]},
                                voxels.ranges().data(),
                                voxels.ranges().size(),
                                voxels.X_VoxelPatient().linear().data(),
                                voxels.X_VoxelPatient().translation().data()};
        if constexpr (std::is_same_v<Kernel, SmallKernel>) {
          if (!points.empty()) sample_sphere(grid, kernel, points.data(), points.size(), &samples[0].value);
        } else {
          constexpr std::size_t kChunk = 32;
          std::array<SpherePoint, kChunk> in_voxels;
          for (std::size_t first = 0; first < points.size(); first += kChunk) {
            const std::size_t count = std::min(kChunk, points.size() - first);
            for (std::size_t n = 0; n < count; ++n) {
              const Point<Voxel> x = voxels.X_VoxelPatient() * points[first + n];
              in_voxels[n] = {{x.x(), x.y(), x.z()}};
            }
            sample_sphere(grid, kernel, in_voxels.data(), count, &samples[first].value);
          }
        }
      },
      voxels.storage());
}

}  // namespace palpate::internal::label_sphere
