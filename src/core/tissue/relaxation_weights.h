#pragma once

#include <cstdint>
#include <vector>

#include "palpate/contact/model.h"
#include "palpate/tissue/carved_cells.h"
#include "palpate/tissue/elastic_grid.h"

namespace palpate {

/// Relaxing fractions and strain stiffening of the tissues in a box of cells, weighted by their contribution
/// to the compliance under a tool.
class RelaxationWeights {
 public:
  /// Whether the model has a tissue that relaxes, or one that stiffens under its law.
  static bool is_needed_for(const Model& model);

  /// Assigns each cell to the tissue at its centre or, if that is not deformable, at one of its corners.
  /// @param model  one for which is_needed_for() is true
  RelaxationWeights(const Model& model, const CarvedLabels& labels, const ElasticGrid& grid);

  struct Means {
    RelaxationFractions relaxed;
    double stiffening = 0;  ///< ElasticConstants::stiffening; 0 unless the law is TissueLaw::kExponential
  };
  /// Means over the tissue under a load, in which each tissue is weighted by its share of the stored energy.
  /// This is the sensitivity of the compliance to the tissue's modulus, dW / W = - sum of share x dE / E,
  /// which follows from W = f K^-1 f.
  /// @param displaced_mm  displacements of the grid's nodes under the load
  Means under(const ElasticGrid& grid, const ElasticField& displaced_mm) const;

  /// Whether the model's tissues have the same relaxation and stiffening as at construction.
  bool was_made_from(const Model& model) const;

 private:
  static constexpr std::uint8_t kNone = 0;  // index into distinct_means_: neither relaxation nor stiffening

  struct TissueKey {
    Relaxation relaxation;
    double stiffening = 0;
    bool operator==(const TissueKey&) const = default;
  };
  static TissueKey of(const Model& model, const Tissue& tissue);

  std::vector<TissueKey> by_tissue_;
  // distinct values over the cells; entry kNone has neither relaxation nor stiffening
  std::vector<Means> distinct_means_;
  std::vector<std::uint8_t> means_of_cell_;  // index into distinct_means_ by cell of the layout
  bool is_uniform_ = true;                   // all deformable cells have the same kind
  std::uint8_t first_ = kNone;               // the first such cell's kind
};

}  // namespace palpate
