#pragma once

#include <memory>

#include "palpate/contact/model.h"
#include "palpate/recording/recording.h"

namespace palpate {

/// Checks that a recording was made with this model. Error kBadInput if it was not.
Result<void> check_recorded_model(const RecordingHeader& recording, const Model& model);

/// The model with the recording's soft-tissue cell size (Model::tissue_cell_factor).
std::shared_ptr<const Model> with_recorded_cell_size(std::shared_ptr<const Model> model,
                                                     const RecordingHeader& recording);

}  // namespace palpate
