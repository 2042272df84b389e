#pragma once

#include <string>

#include "palpate/scene/scene.h"

namespace palpate {

/// A script as TOML that parses to the same steps: what a recording keeps. Comments of a user's file are
/// not in it.
std::string script_text(const Script& script);

}  // namespace palpate
