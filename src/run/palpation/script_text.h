#pragma once

#include <string>

#include "palpate/scene/script.h"

namespace palpate {

/// Script as TOML that parses to the same steps, as stored in a recording. Comments of the user's file are
/// not preserved.
std::string script_text(const Script& script);

}  // namespace palpate
