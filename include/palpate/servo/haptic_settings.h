#pragma once

#include <string>

#include "palpate/servo/servo_settings.h"
#include "palpate/tissue/tissue_settings.h"

/// Constants that determine the haptic behaviour besides the scene and the parameters, as text. They are
/// fixed for one version of palpate and written to every recording. docs/reference/feel.md lists them all.
namespace palpate {

/// Calls `visitor(group, name, value)` for every setting; the value is a double or an int.
template <class Visit>
void visit_haptic_settings(Visit&& visitor) {
  const auto group = [&](const char* title, const auto& settings) {
    settings.visit([&](const char* name, auto value) { visitor(title, name, value); });
  };
  group("proxy", kProxySettings);
  group("tool_turn", kToolRotationSettings);
  group("touch", kContactSettings);
  group("passivity", kPassivitySettings);
  group("swing", kOscillationSettings);
  group("bounce", kReboundSettings);
  group("yield", kSoftTissueSettings);
  group("solving", kSolverSettings);
  group("cutting", kCuttingSettings);
  group("output", kOutputSettings);
  group("turning", kRotationSettings);
  group("burr", kBurrRenderingSettings);
}

/// All settings in the format of a recording's header: one line "group.name value" each. Numbers are written
/// so that they read back exactly.
std::string haptic_settings_text();
/// First difference between this version's settings and those in `text`, as "group.name WAS, here IS"; empty
/// if there is none.
std::string first_haptic_difference(const std::string& text);

}  // namespace palpate
