#pragma once

#include <string>

#include "palpate/scene/new_scene.h"
#include "palpate/scene/scene.h"

namespace palpate {

struct ProposedScene {
  Scene scene;
  std::string note;  ///< Description in one line, including how to save it to a file
};

/// Scene that `scene new` writes for a scan, a label map or both. Errors: those of new_scene_text.
Result<ProposedScene> propose_scene(const NewSceneInput& input);

}  // namespace palpate
