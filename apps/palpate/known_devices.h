#pragma once

#include "palpate/device/registry.h"

namespace palpate::app {

/// The drivers that this program has: whoever adds one adds it here, and nowhere else.
DeviceRegistry known_devices();

}  // namespace palpate::app
