#pragma once

#include <filesystem>
#include <string>

#include "palpate/device/registry.h"
#include "palpate/doctor/held_hand.h"
#include "verb.h"

namespace palpate::app {

/// What was measured on this machine by this user: palpate/held-hands.txt among their data.
std::filesystem::path held_hands_file();
/// Empty where nothing was measured. Errors: those of reading it.
Result<HeldHands> kept_held_hands();
/// The same makers, whose drivers say what was measured of their devices.
DeviceRegistry with_held_hands(const DeviceRegistry& known, const HeldHands& hands, double rate_hz);

/// `palpate doctor --hold NAME`: returns the exit code.
int hold_by_hand(const DeviceRegistry& known, const std::string& name, double rate_hz, bool json,
                 Console& console);

}  // namespace palpate::app
