#pragma once

#include <cstdint>

#include "palpate/device.h"

namespace palpate {

/// A wrench that may go to a device, and why it differs from what was asked (TickFlag bits).
struct SafeWrench {
  Wrench wrench;
  std::uint32_t flags = 0;
};

/// The last stage before a device, unconditional: nothing while paused, nothing that is not finite,
/// nothing above the limit. The clamp keeps the direction and scales the torque alike.
/// @param max_force_N  limit of the force's magnitude; not finite or negative counts as 0
SafeWrench make_safe(const Wrench& asked, double max_force_N, bool paused);

}  // namespace palpate
