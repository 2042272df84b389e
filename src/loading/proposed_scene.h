#pragma once

#include <filesystem>
#include <string>
#include <variant>

#include "palpate/scene/scene.h"
#include "palpate/volume_io/volume_io.h"

namespace palpate {

struct ProposedScene {
  Scene scene;
  std::string note;  ///< what it is, and how to have it as a file, in one line
};

/// The scene that `scene new` writes for a volume by itself. Errors: those of new_scene_text.
Result<ProposedScene> propose_scene(const std::filesystem::path& file, std::optional<int> number,
                                    const std::variant<ScanFile, LabelFile>& volume);

}  // namespace palpate
