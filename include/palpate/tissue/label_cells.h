#pragma once

#include <array>
#include <span>
#include <vector>

#include "palpate/tissue/elastic_grid.h"

/// Material of cells that cover labels.
namespace palpate {

/// Fill below which a cell counts as empty: its nodes would have almost no stiffness.
inline constexpr double kMinFill = 0.02;

/// Homogenised material of a cell's samples.
class ElasticMixture {
 public:
  /// @param solid  solid fraction of the samples of that material
  void add(const ElasticMaterial& material, int samples = 1, double solid = 1);
  ElasticCell cell() const;

 private:
  double samples_ = 0, rigid_ = 0, soft_ = 0;
  double per_mu_ = 0, per_confined_ = 0, stiffening_ = 0;  // sums over soft samples, weighted by fill
};

/// Samples labels at evenly spaced points in each cell of a box.
class LabelCells {
 public:
  LabelCells(const GridGeometry& labels, std::span<const ElasticMaterial> by_label, const ElasticBox& box);

  /// @param removed  as in ElasticGrid::of_labels
  ElasticCell cell(const Bricks<LabelId>& labels, const Bricks<std::uint8_t>* removed, int i, int j,
                   int k) const;
  /// Voxels that cells of the box cover.
  VoxelBox voxels() const;
  /// Cells that cover some of the voxels, possibly with a few adjacent ones.
  CellBox cells_of(const VoxelBox& voxels) const;

 private:
  GridGeometry grid_;
  std::vector<ElasticMaterial> by_label_;
  ElasticBox box_;
  int samples_;  ///< Samples per cell along each axis
  // the voxel position of a sample is a sum of three terms, one per axis of the box
  Eigen::Vector3d corner_;
  std::array<std::vector<Eigen::Vector3d>, 3> part_;
};

}  // namespace palpate
