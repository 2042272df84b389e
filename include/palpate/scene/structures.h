#pragma once

#include <string>
#include <vector>

#include "palpate/haptics/haptics.h"
#include "palpate/scene/scene.h"

namespace palpate {

/// Structures that a file names, in a model, by LabelId. A name stands for every structure that bears it.
/// @param where  of the file: what errors name
/// Errors: kBadInput for one that the model does not have, with those that it has.
Result<std::vector<bool>> labels_in_model(const Model& model, const std::vector<LabelReference>& references,
                                          const std::string& where);

}  // namespace palpate
