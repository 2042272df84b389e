#pragma once

#include "palpate.h"
#include "palpate/device/telemetry.h"

namespace palpate::c {

/// Record of one device's tick, as C has it.
/// @param device  below TickRecord::devices
plp_record record_of(const TickRecord& tick, std::size_t device);

}  // namespace palpate::c
