#pragma once

#include <string>
#include <vector>

#include "palpate/contact/model.h"
#include "palpate/scene/scene.h"

namespace palpate {

/// Resolves structures named in a file to LabelIds of a model. A name refers to every structure of that name.
/// @param where  location in the file, for errors
/// Errors: kBadInput for a structure absent from the model, with a list of those present.
Result<std::vector<bool>> labels_in_model(const Model& model, const std::vector<LabelReference>& references,
                                          const std::string& where);

}  // namespace palpate
