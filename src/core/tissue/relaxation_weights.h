#pragma once

#include <cstdint>
#include <vector>

#include "palpate/contact/haptics.h"
#include "palpate/tissue/carved_cells.h"
#include "palpate/tissue/elastic_grid.h"

namespace palpate {

/// Relaxing fractions of the tissues in a box of cells, weighted by their contribution to the compliance
/// under a tool.
class RelaxationWeights {
 public:
  /// Assigns each cell to the tissue at its centre or, if that is not deformable, at one of its corners.
  /// @param model  with at least one relaxing tissue
  RelaxationWeights(const Model& model, const CarvedLabels& labels, const ElasticGrid& grid);

  /// Relaxation of the tissue under a load: each tissue's series weighted by its share of the stored energy.
  /// This is the sensitivity of the compliance to the tissue's modulus, dW / W = - sum of share x dE / E,
  /// which follows from W = f K^-1 f.
  /// @param displaced_mm  displacements of the grid's nodes under the load
  RelaxedParts relaxed(const ElasticGrid& grid, const ElasticField& displaced_mm) const;

  /// Whether the model's tissues have the same relaxation as at construction.
  bool is_of(const Model& model) const;

 private:
  static constexpr std::uint8_t kNone = 0;  // index into kinds_: no relaxation

  std::vector<Relaxation> by_tissue_;
  std::vector<RelaxedParts> kinds_;  // distinct relaxations; the first is none
  std::vector<std::uint8_t> kind_;   // index into kinds_ by cell of the layout
  bool alike_ = true;                // all deformable cells have the same kind
  std::uint8_t first_ = kNone;       // the first such cell's kind
};

}  // namespace palpate
