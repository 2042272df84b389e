#pragma once

#include <memory>

#include "palpate/haptics/haptics.h"
#include "palpate/recording/recording.h"

namespace palpate {

/// Whether a recording was made with this model. Error kBadInput where it was not.
Result<void> check_recorded_model(const RecordingHeader& recording, const Model& model);

/// The model as a recording's session had it: its soft tissue in cells as coarse (Model::tissue_coarsened).
std::shared_ptr<const Model> solved_as_recorded(std::shared_ptr<const Model> model,
                                                const RecordingHeader& recording);

}  // namespace palpate
