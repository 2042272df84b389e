#pragma once

#include <string>

#include "palpate/json/json.h"
#include "palpate/link/viewed_training.h"

/// What viewers are told of tasks (docs/reference/viewer-messages.md).
namespace palpate::link {

palpate::Json task_json(const ViewedTask& task);
/// How far a run is.
std::string training_json(const ViewedTraining& training);
/// Of samples and patches thousandths, of figures every digit.
std::string debriefing_json(const ViewedDebriefing& debriefing);

}  // namespace palpate::link
