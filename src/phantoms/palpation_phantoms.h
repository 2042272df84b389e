#pragma once

#include <optional>

#include "palpate/phantoms/phantoms.h"

namespace palpate {

/// Free space above what is palpated, for a tip to come from, and around it.
inline constexpr double kFreeAbove_mm = 15, kFreeAround_mm = 5;

/// Where a block's or a dome's nodules lie. Empty: they do not fit in, or not beside each other.
std::optional<std::vector<PhantomNodule>> nodules_of(const BlockParameters& block);
std::optional<std::vector<PhantomNodule>> nodules_of(const DomeParameters& dome);

}  // namespace palpate
