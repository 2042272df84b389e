#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "palpate/haptics/haptics.h"
#include "palpate/tissue/elastic_grid.h"
#include "palpate/tissue/elastic_solver.h"
#include "palpate/tissue/label_cells.h"

namespace palpate {

/// What each label of a model is made of: what is felt and has a modulus yields, what has none is rigid.
std::vector<ElasticMaterial> materials_of(const Model& model);

/// Labels of which something may be gone.
struct CarvedLabels {
  std::shared_ptr<const Bricks<LabelId>> made;  ///< as they were
  /// Carving::taken; null: nothing is gone.
  std::shared_ptr<const Bricks<std::uint8_t>> taken;
};
CarvedLabels carved_labels(const Model& model);

/// The voxels of a box at which two versions differ, as a box; null is 0 everywhere. The work goes with the
/// bricks that they do not share.
VoxelBox changed_voxels(const Bricks<std::uint8_t>* before, const Bricks<std::uint8_t>* now,
                        const VoxelBox& within);

/// Cells that follow what is taken away from the labels that they are made of, and what is put back. What has
/// changed is sampled again, in place; a cell's fill changes by no more than kSolvingFeel.most_fill_change at
/// a time, so that a solver with a few iterations goes along.
class CarvedCells {
 public:
  /// With springs on all faces.
  CarvedCells(CarvedLabels labels, const std::vector<ElasticMaterial>& by_label, const ElasticBox& box,
              const Point<Patient>& about);

  const ElasticGrid& grid() const { return grid_; }
  /// That they follow, as of the last step.
  const CarvedLabels& labels() const { return labels_; }

  /// One step. @returns the cells that may be others now
  CellBox follow(const CarvedLabels& labels, ElasticSolver& solver);
  /// Cells that have a way to go yet.
  const CellBox& on_their_way() const { return on_their_way_; }
  /// Where cells of others that are on their way are these cells too, these stand where those do.
  /// @param offset  from the number of one of these cells to that of the other
  void take_over(const CarvedCells& other, const std::array<int, 3>& offset);

 private:
  void note_changes(const CarvedLabels& labels);

  CarvedLabels labels_;
  LabelCells cells_;
  ElasticGrid grid_;
  CellBox on_their_way_;
};

}  // namespace palpate
