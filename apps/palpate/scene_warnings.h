#pragma once

#include "apps/command/console.h"
#include "palpate/scene/scene.h"

namespace palpate::app {

/// Warns if the law deforms tissue but no tissue is deformable.
void warn_if_nothing_deforms(const Scene& scene, Console& console);
/// Warns of a stiffness that has no effect: deformable tissue is rendered from its modulus, and the stiffness
/// given with its preset is used by the other laws only.
void warn_of_ignored_stiffness(const Scene& scene, Console& console);

}  // namespace palpate::app
