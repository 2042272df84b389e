#pragma once

#include <string>

#include "palpate/link/viewed_plan.h"

/// Plan message of the server (docs/reference/viewer-messages.md).
namespace palpate::link {

std::string plan_json(const ViewedPlan& plan);

}  // namespace palpate::link
