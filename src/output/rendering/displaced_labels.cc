#include <array>
#include <cmath>

#include "palpate/rendering/rendering.h"

namespace palpate {
namespace {

/// Side length of the blocks that are tested as a whole; voxels.
constexpr int kSampledSide = 8;
/// Displacement below which a block counts as at rest; voxels. Displacements below one half do not change the
/// nearest voxel; the margin allows for larger ones between the sampled points.
constexpr double kMinMoved = 0.1;

}  // namespace

PatchOf<LabelId> moved_labels(const Bricks<LabelId>& labels, const TissueDisplacement& moved,
                              const VoxelBox& within) {
  const GridGeometry& grid = labels.geometry();
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  const auto X_VoxelPatient = X_PatientVoxel.inverse();
  const auto boxes = [&](std::size_t axis) { return (within.size[axis] + kSampledSide - 1) / kSampledSide; };
  const auto first_of = [&](std::size_t axis, int n) { return within.first[axis] + kSampledSide * n; };
  const auto end_of = [&](std::size_t axis, int n) {
    return std::min(within.first[axis] + within.size[axis], first_of(axis, n + 1));
  };
  // fields are smooth: 3 x 3 x 3 samples suffice to detect whether anything in a block moves
  const auto moves = [&](const std::array<int, 3>& box) {
    for (int n = 0; n < 27; ++n) {
      const double half = 0.5 * kSampledSide;
      const Point<Voxel> at(first_of(0, box[0]) + half * (n % 3), first_of(1, box[1]) + half * (n / 3 % 3),
                            first_of(2, box[2]) + half * (n / 9));
      const Vector<Voxel> by = X_VoxelPatient * moved(X_PatientVoxel * at);
      if (!(by.eigen().cwiseAbs().maxCoeff() <= kMinMoved)) return true;
    }
    return false;
  };
  std::vector<std::array<int, 3>> moving;
  std::array<int, 3> low = grid.dims, high{0, 0, 0};
  for (int c = 0; c < boxes(2); ++c)
    for (int b = 0; b < boxes(1); ++b)
      for (int a = 0; a < boxes(0); ++a) {
        const std::array<int, 3> box{a, b, c};
        if (!moves(box)) continue;
        moving.push_back(box);
        for (std::size_t axis = 0; axis < 3; ++axis) {
          low[axis] = std::min(low[axis], first_of(axis, box[axis]));
          high[axis] = std::max(high[axis], end_of(axis, box[axis]));
        }
      }
  PatchOf<LabelId> patch;
  if (moving.empty()) return patch;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    patch.box.first[axis] = low[axis];
    patch.box.size[axis] = high[axis] - low[axis];
  }
  patch.values.resize(patch.box.voxel_count());
  const auto row = [&](int j, int k) {
    return patch.values.data() +
           static_cast<std::size_t>(patch.box.size[0]) *
               (static_cast<std::size_t>(j - low[1]) +
                static_cast<std::size_t>(patch.box.size[1]) * static_cast<std::size_t>(k - low[2]));
  };
  for (int k = low[2]; k < high[2]; ++k)
    for (int j = low[1]; j < high[1]; ++j) labels.copy_row(low[0], j, k, patch.box.size[0], row(j, k));
  for (const std::array<int, 3>& box : moving)
    for (int k = first_of(2, box[2]); k < end_of(2, box[2]); ++k)
      for (int j = first_of(1, box[1]); j < end_of(1, box[1]); ++j)
        for (int i = first_of(0, box[0]); i < end_of(0, box[0]); ++i) {
          const Point<Voxel> displayed(i, j, k);
          const Eigen::Vector3d from =
              (X_VoxelPatient * rest_position(X_PatientVoxel * displayed, moved)).eigen().array().round();
          const bool is_in = (from.array() >= 0).all() && from[0] < grid.dims[0] && from[1] < grid.dims[1] &&
                             from[2] < grid.dims[2];
          row(j, k)[i - low[0]] = is_in ? labels.at(static_cast<int>(from[0]), static_cast<int>(from[1]),
                                                    static_cast<int>(from[2]))
                                        : LabelId{0};
        }
  return patch;
}

}  // namespace palpate
