#pragma once

#include <filesystem>
#include <string>

#include "palpate/device/registry.h"
#include "palpate/doctor/held_hand.h"
#include "verb.h"

namespace palpate::app {

/// File with the results of this user's `doctor --hold` measurements on this machine: palpate/held-hands.txt
/// in the user's data folder.
std::filesystem::path held_hands_file();
/// Stored measurements; empty if there are none. Errors: those of reading the file.
Result<HeldHands> stored_held_hands();
/// The same registry, with drivers that report the measured hand of their devices.
DeviceRegistry with_held_hands(const DeviceRegistry& known, const HeldHands& hands, double rate_hz);

/// Implements `palpate doctor --hold NAME`; returns the exit code.
int hold_by_hand(const DeviceRegistry& known, const std::string& name, double rate_hz, bool json,
                 Console& console);

}  // namespace palpate::app
