#pragma once

#include <memory>
#include <vector>

#include "palpate.h"
#include "palpate/volume/bricks.h"

namespace palpate::c {

/// Labels of a C caller, in bricks.
struct LabelBricks {
  std::shared_ptr<const Bricks<LabelId>> bricks;
  std::vector<bool> present;  ///< By label: whether any voxel has it
};

/// Reads a label volume slice by slice, so that no dense copy of it is made. Errors: kBadInput for an invalid
/// grid, type or memory order, and for values that are no labels.
Result<LabelBricks> label_bricks_of(const plp_labels& labels);

}  // namespace palpate::c
