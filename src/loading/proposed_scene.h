#pragma once

#include <string>

#include "palpate/scene/scene.h"

namespace palpate {

struct ProposedScene {
  Scene scene;
  std::string note;  ///< what it is, and how to have it as a file, in one line
};

/// The scene that `scene new` writes for a scan, a label map, or both. Errors: those of new_scene_text.
Result<ProposedScene> propose_scene(const NewSceneInput& input);

}  // namespace palpate
