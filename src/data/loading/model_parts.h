#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "palpate/loading/loading.h"
#include "palpate/model/make_model.h"

namespace palpate {

/// Inputs of the model, with labels in bricks, and the weights from which its field is smoothed.
struct ReadyParts {
  ModelParts parts;
  std::shared_ptr<const Volume<float>> scan;
  Volume<std::uint8_t> weights;                 ///< Empty for ramps
  std::vector<std::vector<LabelId>> enclosing;  ///< As Model::enclosing
};

/// Makes a model's inputs from a scene and its volumes, which are consumed: one label per voxel of the finer
/// of their grids, with tissues, no-go regions and reported distances. Errors: kBadInput, kInterrupted, and
/// those of check_memory().
Result<ReadyParts> ready_parts(const Scene& scene, SceneVolumes& volumes, const Progress& progress,
                               const Warn& warn);

}  // namespace palpate
