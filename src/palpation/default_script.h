#pragma once

#include <optional>

#include "palpate/haptics/haptics.h"
#include "palpate/scene/scene.h"
#include "palpate/servo/servo.h"

namespace palpate {

/// The embedded script of a knee, where the model has every structure that it approaches.
std::optional<Script> knee_script(const Model& model);

/// Adds an approach, a press, a hold and a leave for each of the largest felt structures that the tool can
/// reach, at most kMaxPalpated; structures on the way to these that it cannot reach become limitations.
/// Error kBadInput where it can reach none.
/// A press asks for 1 N, and for less where a quasi-static descent (sweep_force) at the place gives less than
/// 1.67 N within 40 % of the structure's thickness: then that force and its depth become a limitation, too.
/// @param model       ready for the method of `parameters`
/// @param parameters  of the run's first tick
Result<void> plan_default_script(const Model& model, const Parameters& parameters, Script& script);
inline constexpr std::size_t kMaxPalpated = 6;

}  // namespace palpate
