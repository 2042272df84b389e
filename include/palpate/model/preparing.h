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

/// What takes seconds of making a model. Here everything is computed; who keeps results between runs derives
/// a class of his own, whose results are the same bit for bit.
class Preparing {
 public:
  virtual ~Preparing() = default;

  /// prepare_ramps, with its errors.
  virtual Result<Ramps> ramps(const Bricks<LabelId>& labels, const std::vector<RampStructure>& structures,
                              const RampOptions& options, const Progress& progress) const;
  /// palpate::touching_pairs, with its errors.
  virtual Result<std::vector<std::pair<LabelId, LabelId>>> touching_pairs(
      const Bricks<LabelId>& labels, const std::vector<LabelId>& structures, const Progress& progress) const;
  /// The surfaces of prepare_outer_surfaces, in the order of the groups, with its errors. Groups may have
  /// structures in common.
  virtual Result<std::vector<std::shared_ptr<const Surface>>> outer_surfaces(
      const Bricks<LabelId>& labels, const std::vector<std::vector<LabelId>>& groups,
      const SurfaceOptions& options, const Progress& progress) const;
};

/// Places of groups that can be prepared together, as they have no structure in common; every group is in one
/// of as few goes as taking them in their order makes.
std::vector<std::vector<std::size_t>> in_goes(const std::vector<std::vector<LabelId>>& groups);

}  // namespace palpate
