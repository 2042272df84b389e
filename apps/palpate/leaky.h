#pragma once

#include <functional>
#include <string>
#include <vector>

#include "palpate/surfaces/surfaces.h"

namespace palpate::app {

/// "leaky, ...: skull 12 (one at 1.5, -20.0, 33.0 mm LPS), ...", the leakiest first.
std::string leaky_text(std::vector<Leaks> leaks, const std::function<std::string(LabelId)>& name_of);

}  // namespace palpate::app
