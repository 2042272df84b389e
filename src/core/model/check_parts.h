#pragma once

#include "palpate/model/make_model.h"

namespace palpate {

/// Checks that a model can be made of these parts: labels on a valid grid, indices within their lists, finite
/// properties and tools. Ranges that a scene file has in addition are not checked. Errors: kBadInput with the
/// name of the member as location.
Result<void> check_parts(const ModelParts& parts);

}  // namespace palpate
