#pragma once

#include "palpate/haptics/haptics.h"
#include "palpate/recording/recording.h"

namespace palpate {

/// Whether a recording was made with this model. Error kBadInput where it was not.
Result<void> check_recorded_model(const RecordingHeader& recording, const Model& model);

}  // namespace palpate
