#pragma once

#include "scene/keys.h"

namespace palpate {

struct PlanKeys {
  TableSpec top, trajectory, region, distance;
};
const PlanKeys& plan_key_tables();

}  // namespace palpate
