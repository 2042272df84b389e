#include <cmath>
#include <new>
#include <stdexcept>

#include "phantoms/shape_blocks.h"

namespace palpate {
namespace {

Result<void> check_grid(const GridGeometry& grid) {
  for (const int n : grid.dims) {
    if (n < 1)
      return Error{ErrorKind::kBadInput, "a grid without voxels", "", "give every axis at least one"};
  }
  const Eigen::Matrix3d linear = grid.X_PatientVoxel().linear();
  if (!linear.allFinite() || !grid.origin.all_finite() || std::abs(linear.determinant()) < 1e-12) {
    return Error{ErrorKind::kBadInput, "a grid without extent", "", "give finite, positive spacings"};
  }
  return {};
}

Error too_large() {
  return {ErrorKind::kBadInput, "not enough memory for a grid of this size", "", "use larger voxels"};
}

// Reduces the shape to a block; a block that is completely inside or outside is written at once.
template <class T>
auto narrow_or_fill(Volume<T>& volume, T inside) {
  return [&volume, inside](const Shape::Node::Ptr& node, const VoxelBlock& block,
                           const Ball& ball) -> std::optional<Shape::Node::Ptr> {
    const Shape::Node::Within here = node->within(node, ball);
    if (std::abs(here.distance) <= ball.radius) return here.node;
    if (here.distance < 0) block.for_each_voxel([&](int i, int j, int k) { volume.at(i, j, k) = inside; });
    return {};
  };
}

// offsets of n^3 evenly spaced points from a voxel's centre; mm
std::vector<Eigen::Vector3d> subsample_offsets(const GridGeometry& grid, int n) {
  const Eigen::Matrix3d linear = grid.X_PatientVoxel().linear();
  const auto centre_of = [n](int s) { return (s + 0.5) / n - 0.5; };
  std::vector<Eigen::Vector3d> offsets;
  for (int k = 0; k < n; ++k) {
    for (int j = 0; j < n; ++j) {
      for (int i = 0; i < n; ++i)
        offsets.push_back(linear * Eigen::Vector3d(centre_of(i), centre_of(j), centre_of(k)));
    }
  }
  return offsets;
}

float covered_fraction(const Shape::Node& node, const Eigen::Vector3d& centre,
                       const std::vector<Eigen::Vector3d>& offsets, double voxel_radius) {
  const double d = node.distance(centre);
  if (std::abs(d) >= voxel_radius) return d < 0 ? 1.0f : 0.0f;
  int inside = 0;
  for (const Eigen::Vector3d& offset : offsets) inside += node.distance(centre + offset) < 0 ? 1 : 0;
  return static_cast<float>(inside) / static_cast<float>(offsets.size());
}

}  // namespace

Result<Volume<float>> voxelize_coverage(const Shape& shape, const GridGeometry& grid, int subsamples,
                                        const Progress& progress) try {
  if (const Result<void> usable = check_grid(grid); !usable) return usable.error();
  if (subsamples < 1 || subsamples > 16) {
    return Error{ErrorKind::kBadInput, "sub-samples per axis must be 1 ... 16", "", ""};
  }
  Volume<float> coverage(grid);
  const std::vector<Eigen::Vector3d> offsets = subsample_offsets(grid, subsamples);
  const double voxel_radius = half_diagonal_mm(grid, Eigen::Vector3d::Ones());
  const Transform<Patient, Voxel> X_PatientVoxel = grid.X_PatientVoxel();
  const auto leaf = [&](const Shape::Node::Ptr& node, const VoxelBlock& block) {
    block.for_each_voxel([&](int i, int j, int k) {
      const Eigen::Vector3d centre = (X_PatientVoxel * Point<Voxel>(i, j, k)).eigen();
      coverage.at(i, j, k) = covered_fraction(*node, centre, offsets, voxel_radius);
    });
  };
  if (!visit_grid(grid, shape.node(), "voxelising", progress, narrow_or_fill(coverage, 1.0f), leaf)) {
    return Progress::interrupted();
  }
  return coverage;
} catch (const std::bad_alloc&) {
  return too_large();
} catch (const std::length_error&) {
  return too_large();
}

Result<Volume<LabelId>> voxelize_binary(const Shape& shape, const GridGeometry& grid, LabelId label,
                                        const Progress& progress) try {
  if (const Result<void> usable = check_grid(grid); !usable) return usable.error();
  Volume<LabelId> labels(grid);
  const Transform<Patient, Voxel> X_PatientVoxel = grid.X_PatientVoxel();
  const auto leaf = [&](const Shape::Node::Ptr& node, const VoxelBlock& block) {
    block.for_each_voxel([&](int i, int j, int k) {
      if (node->distance((X_PatientVoxel * Point<Voxel>(i, j, k)).eigen()) < 0) labels.at(i, j, k) = label;
    });
  };
  if (!visit_grid(grid, shape.node(), "voxelising", progress, narrow_or_fill(labels, label), leaf)) {
    return Progress::interrupted();
  }
  return labels;
} catch (const std::bad_alloc&) {
  return too_large();
} catch (const std::length_error&) {
  return too_large();
}

}  // namespace palpate
