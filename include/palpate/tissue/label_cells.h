#pragma once

#include <array>
#include <span>
#include <vector>

#include "palpate/tissue/elastic_grid.h"

/// What cells are made of that cover labels.
namespace palpate {

/// Less of a cell is nothing: its nodes would hang on next to no stiffness.
inline constexpr double kLeastFill = 0.02;

/// What the samples of a cell say.
class ElasticMixture {
 public:
  /// @param solid  what part of the samples is solid, where that material is
  void add(const ElasticMaterial& material, int samples = 1, double solid = 1);
  ElasticCell cell() const;

 private:
  double samples_ = 0, rigid_ = 0, soft_ = 0;
  double per_mu_ = 0, per_confined_ = 0;
};

/// Samples labels at even places in each cell of a box.
class LabelCells {
 public:
  LabelCells(const GridGeometry& labels, std::span<const ElasticMaterial> by_label, const ElasticBox& box);

  /// @param taken  as ElasticGrid::of_labels has it
  ElasticCell cell(const Bricks<LabelId>& labels, const Bricks<std::uint8_t>* taken, int i, int j,
                   int k) const;
  /// Of these voxels all that cells of the box are made of.
  VoxelBox voxels() const;
  /// The cells that are made of some voxels, and maybe a few beside them.
  CellBox cells_of(const VoxelBox& voxels) const;

 private:
  GridGeometry grid_;
  std::vector<ElasticMaterial> by_label_;
  ElasticBox box_;
  int samples_;  ///< of a cell along each axis
  // the voxel of a place is a sum of three parts, one for each axis of the box
  Eigen::Vector3d corner_;
  std::array<std::vector<Eigen::Vector3d>, 3> part_;
};

}  // namespace palpate
