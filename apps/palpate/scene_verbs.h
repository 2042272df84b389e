#pragma once

#include "verb.h"

namespace palpate::app {

/// Adds the verbs `scene new` and `scene check` to `scene`.
void add_scene_new(CLI::App& app, Run& run);
void add_scene_check(CLI::App& app, Run& run);

}  // namespace palpate::app
