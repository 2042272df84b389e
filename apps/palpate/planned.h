#pragma once

#include <memory>
#include <string>
#include <vector>

#include "palpate/json/json.h"
#include "palpate/rehearsal/comparison.h"
#include "verb.h"

namespace palpate::app {

/// A scene as a plan is looked at in: with the surfaces that the proxy leans on, where anything is felt.
struct PlannedScene {
  std::shared_ptr<const Model> model;
  PlanInScene plan;
  std::vector<StructureDistance> distances;
};
/// Errors: those of resolve_plan, ready_for and structure_distances.
Result<PlannedScene> scene_of_plan(const PlanFile& plan, std::shared_ptr<const Model> model,
                                   Console& console);

/// A recording beside a plan. Errors: those of compare_recording and check_recorded_model, with the
/// recording's name.
Result<PlanComparison> compare_run(const PlannedScene& scene, const RecordingSource& recording,
                                   const std::string& name, std::size_t device, Console& console);

/// A comparison as `palpate plan compare --json` writes it.
Json json_of(const PlannedScene& scene, const PlanComparison& made);

}  // namespace palpate::app
