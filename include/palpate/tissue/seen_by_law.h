#pragma once

#include "palpate/haptics/haptics.h"

namespace palpate {

/// A model whose soft tissue goes by another law, for who solves and looks and does not feel: its layers are
/// those of the law that it had (under_law, palpate/model/changed_model.h, makes others).
Model seen_under_law(const Model& model, TissueLaw law);

}  // namespace palpate
