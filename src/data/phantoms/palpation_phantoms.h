#pragma once

#include <optional>

#include "palpate/phantoms/phantoms.h"

namespace palpate {

/// Free space above the phantom, from which a tip approaches, and around it.
inline constexpr double kFreeAbove_mm = 15, kFreeAround_mm = 5;

/// Positions of the nodules of a block or dome; nullopt if they do not fit into the tissue or next to each
/// other.
std::optional<std::vector<PhantomNodule>> nodules_of(const BlockParameters& block);
std::optional<std::vector<PhantomNodule>> nodules_of(const DomeParameters& dome);

}  // namespace palpate
