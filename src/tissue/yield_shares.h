#pragma once

#include <cstdint>
#include <vector>

#include "palpate/haptics/haptics.h"
#include "palpate/tissue/carved_cells.h"
#include "palpate/tissue/elastic_grid.h"

namespace palpate {

/// Which of the tissues in a box of cells give way under a tool, and so how what it feels relaxes.
class YieldShares {
 public:
  /// A cell counts to the tissue in its middle, or to one beside that where it is none that yields.
  /// @param model  with a tissue that relaxes
  YieldShares(const Model& model, const CarvedLabels& labels, const ElasticGrid& grid);

  /// What relaxes of a load's own way: of each tissue the parts of its series, by the part of the energy that
  /// is stored in it. By just that part the compliance changes with the tissue's modulus, dW / W = - sum of
  /// share x dE / E, as W = f K^-1 f says.
  /// @param displaced_mm  under the load, of the grid's nodes
  RelaxedParts relaxed(const ElasticGrid& grid, const ElasticField& displaced_mm) const;

  /// Whether the model's tissues relax as they did.
  bool is_of(const Model& model) const;

 private:
  static constexpr std::uint8_t kNone = 0;  // of kinds: what does not relax

  std::vector<Relaxation> by_tissue_;
  std::vector<RelaxedParts> kinds_;  // the first relaxes by nothing
  std::vector<std::uint8_t> kind_;   // of the layout's cells
  bool alike_ = true;                // all that yields is of one kind
  std::uint8_t first_ = kNone;       // that one
};

}  // namespace palpate
