#pragma once

#include "palpate/contact/model.h"

namespace palpate {

/// Model under another constitutive law, for solving and display without contact: the force layers remain
/// those of the original law (under_law in palpate/model/changed_model.h rebuilds them).
Model displayed_under_law(const Model& model, TissueLaw law);

}  // namespace palpate
