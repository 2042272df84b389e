#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/device/registry.h"

namespace palpate::app {

/// What a user says about devices, as NAME=VALUE each.
struct DeviceOptions {
  std::vector<std::string> libraries;    ///< the file of a maker's library
  std::vector<std::string> held_masses;  ///< kg that is held at a device's end
  /// a name by which its maker's setup knows a device, several of one maker
  std::vector<std::string> configs;
};
/// `--library`, `--held-mass`, `--device-config`.
void add_device_options(CLI::App& verb, DeviceOptions& options);

/// The drivers that this program has: whoever adds one adds it here, and nowhere else.
/// Errors: kUsage for a name that is none, or a value that is none.
Result<DeviceRegistry> known_devices(const DeviceOptions& options = {});

}  // namespace palpate::app
