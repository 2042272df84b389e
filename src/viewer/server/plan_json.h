#pragma once

#include <string>

#include "palpate/server/viewed_plan.h"

/// Plan message of the server (docs/reference/viewer-messages.md).
namespace palpate::server {

std::string plan_json(const ViewedPlan& plan);

}  // namespace palpate::server
