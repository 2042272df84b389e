#pragma once

#include "scene/keys.h"

namespace palpate {

struct TaskKeys {
  TableSpec top, region, step, force, protection, metric, answer, scope, microscope, drawn;
};
const TaskKeys& task_key_tables();

}  // namespace palpate
