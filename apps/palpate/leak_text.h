#pragma once

#include <functional>
#include <string>
#include <vector>

#include "palpate/surfaces/surfaces.h"

namespace palpate::app {

/// List of the leaks of structures, largest number first: "leaky, ...: skull 12 (one at 1.5, -20.0, 33.0 mm
/// LPS), ...".
std::string describe_leaks(std::vector<Leaks> leaks, const std::function<std::string(LabelId)>& name_of);

}  // namespace palpate::app
