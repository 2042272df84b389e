#pragma once

#include <optional>

#include "palpate/contact/model.h"
#include "palpate/scene/script.h"
#include "palpate/servo/servo.h"

namespace palpate {

/// Embedded script of a knee; empty unless the model has every structure that it approaches.
std::optional<Script> knee_script(const Model& model);

/// Adds an approach, a press, a hold and a leave for each of the largest touchable structures that the tool
/// can reach, at most kMaxPalpated. Larger structures that it cannot reach become limitations. A press
/// requests 1 N. It requests less where a quasi-static descent (sweep_force) at that place gives less
/// than 1.67 N within 40 % of the thickness of the structure; that force and its depth are then listed as a
/// limitation.
/// @param model       ready for the method of `parameters`
/// @param parameters  parameters of the first tick of the run
/// Errors: kBadInput if no structure can be reached.
Result<void> plan_default_script(const Model& model, const Parameters& parameters, Script& script);
inline constexpr std::size_t kMaxPalpated = 6;

}  // namespace palpate
