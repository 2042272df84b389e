#pragma once

#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"
#include "palpate/surfaces/ramps.h"
#include "palpate/surfaces/surfaces.h"

namespace palpate {

/// The steps of building a model that take seconds. This class computes everything; a derived class may cache
/// results between runs, which must be bit-identical.
class ModelPreparation {
 public:
  virtual ~ModelPreparation() = default;

  /// Calls prepare_ramps(), with its errors.
  virtual Result<Ramps> ramps(const Bricks<LabelId>& labels, const std::vector<RampStructure>& structures,
                              const RampOptions& options, const Progress& progress) const;
  /// Calls palpate::touching_pairs(), with its errors.
  virtual Result<std::vector<std::pair<LabelId, LabelId>>> touching_pairs(
      const Bricks<LabelId>& labels, const std::vector<LabelId>& structures, const Progress& progress) const;
  /// Surfaces of prepare_outer_surfaces() in the order of the groups, with its errors. Groups may overlap.
  virtual Result<std::vector<std::shared_ptr<const Surface>>> outer_surfaces(
      const Bricks<LabelId>& labels, const std::vector<std::vector<LabelId>>& groups,
      const SurfaceOptions& options, const Progress& progress) const;
};

/// Partitions groups into batches that have no structure in common and can be prepared together; first-fit in
/// their order. Contains indices of the groups.
std::vector<std::vector<std::size_t>> disjoint_batches(const std::vector<std::vector<LabelId>>& groups);

}  // namespace palpate
