#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "palpate/contact/model.h"
#include "palpate/tissue/elastic_grid.h"
#include "palpate/tissue/elastic_solver.h"
#include "palpate/tissue/label_cells.h"

namespace palpate {

/// Material of each label of a model: soft if its tissue is touchable and has a modulus, rigid if it is
/// touchable and has none, otherwise empty.
std::vector<ElasticMaterial> materials_of(const Model& model);

/// Label volume together with what has been removed from it.
struct CarvedLabels {
  std::shared_ptr<const Bricks<LabelId>> original;  // labels before removal
  /// Carving::removed_fraction; null: no tissue removed.
  std::shared_ptr<const Bricks<std::uint8_t>> removed_fraction;
};
/// Labels before removal, and the removal, of a model.
CarvedLabels carved_labels(const Model& model);

/// Bounding box of the voxels inside `within` at which two versions differ; null stands for 0 everywhere. The
/// cost is proportional to the number of bricks that the versions do not share.
VoxelBox changed_voxels(const Bricks<std::uint8_t>* before, const Bricks<std::uint8_t>* now,
                        const VoxelBox& within);

/// Cells of a box that follow changes of the labels they cover, in place. Changed cells are sampled again. A
/// cell's fill changes by at most kSolverSettings.max_fill_change per step, so that a solver with few
/// iterations per frame stays converged.
class CarvedCells {
 public:
  /// Samples the cells, with springs on all faces of the box.
  CarvedCells(CarvedLabels labels, const std::vector<ElasticMaterial>& by_label, const ElasticBox& box,
              const Point<Patient>& about);

  const ElasticGrid& grid() const { return grid_; }
  /// Labels that the cells represent, as of the last step.
  const CarvedLabels& labels() const { return labels_; }

  /// Advances the cells by one step towards `labels` and updates `solver`.
  /// @returns cells that may have changed
  CellBox follow(const CarvedLabels& labels, ElasticSolver& solver);
  /// Cells that have not reached their target fill yet.
  const CellBox& changing_cells() const { return changing_cells_; }
  /// Copies the state of cells that are still changing in `other` to the same cells here.
  /// @param offset  added to a cell's index here gives its index in `other`
  void copy_overlap(const CarvedCells& other, const std::array<int, 3>& offset);

 private:
  void mark_changed_cells(const CarvedLabels& labels);

  CarvedLabels labels_;
  LabelCells cells_;
  ElasticGrid grid_;
  CellBox changing_cells_;
};

}  // namespace palpate
