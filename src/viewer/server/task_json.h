#pragma once

#include <string>

#include "palpate/json/json.h"
#include "palpate/server/viewed_training.h"

/// Task messages of the server (docs/reference/viewer-messages.md).
namespace palpate::server {

palpate::Json task_json(const ViewedTask& task);
/// Progress of a run.
std::string training_json(const ViewedTraining& training);
/// Samples and patches rounded to thousandths; metrics with all digits.
std::string debriefing_json(const ViewedDebriefing& debriefing);

}  // namespace palpate::server
