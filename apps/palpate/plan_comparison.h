#pragma once

#include <memory>
#include <string>
#include <vector>

#include "palpate/json/json.h"
#include "palpate/recording/recording_source.h"
#include "palpate/rehearsal/comparison.h"
#include "verb.h"

namespace palpate::app {

/// A plan in its scene. The model has the surfaces used by the proxy if the scene has touchable tissue.
struct PlannedScene {
  std::shared_ptr<const Model> model;
  PlanInScene plan;
  std::vector<StructureDistance> distances;
};
/// Resolves a plan in a model and makes the model ready for the proxy. Errors: those of resolve_plan,
/// prepared_with_cache and structure_distances.
Result<PlannedScene> scene_of_plan(const PlanFile& plan, std::shared_ptr<const Model> model,
                                   Console& console);

/// Compares a recording with a plan. Errors: those of compare_recording and check_recorded_model, with the
/// name of the recording.
Result<PlanComparison> compare_run(const PlannedScene& scene, const RecordingSource& recording,
                                   const std::string& name, std::size_t device, Console& console);

/// JSON of a comparison, as written by `palpate plan compare --json`.
Json json_of(const PlannedScene& scene, const PlanComparison& made);

}  // namespace palpate::app
