#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/device/registry.h"
#include "palpate/navigation/navigated_tip.h"
#include "palpate/tracker/tracker_stream.h"

namespace palpate::app {

/// Options for the stream of a tracker.
struct StreamOptions {
  std::string transform, reference;  ///< Members of TrackerSettings with these names
  std::filesystem::path tip;         ///< File written by palpate pivot
};
/// Adds `--transform` and `--reference`.
void add_stream_options(CLI::App& verb, StreamOptions& options);
/// Adds `--tip`.
void add_tip_option(CLI::App& verb, StreamOptions& options);
/// Reads a file written by palpate pivot. Errors: those of reading the file and of parse_tip().
Result<ToolTip> read_tip(const std::filesystem::path& file);

/// Options for devices, each as NAME=VALUE, and for a tracked tool.
struct DeviceOptions {
  std::vector<std::string> libraries;    ///< Library file of a vendor
  std::vector<std::string> held_masses;  ///< Mass attached to the end of a device, kg
  /// Name of a device in the setup of its vendor; may be repeated for several devices of one vendor
  std::vector<std::string> configs;
  std::string tracker;  ///< HOST:PORT
  StreamOptions stream;
  std::filesystem::path registration;  ///< File written by palpate register
};
/// Adds `--library`, `--held-mass`, `--device-config` and `--tracker`.
void add_device_options(CLI::App& verb, DeviceOptions& options);

/// Tracked tool with its tracker and registration; null: no tracked tool was given.
/// Errors: kUsage if some of its options are missing, and those of its files.
Result<std::shared_ptr<const Navigation>> navigation_of(const DeviceOptions& options);

/// Registry of the drivers of this program. A new driver is added here and nowhere else.
/// @param navigation  tracked tool; if set, it is available as a device
/// @param names       requested device names; plugin=FILE denotes a plug-in
/// Errors: kUsage for an unknown device name or an invalid value.
Result<DeviceRegistry> known_devices(const DeviceOptions& options = {},
                                     const std::shared_ptr<const Navigation>& navigation = nullptr,
                                     const std::vector<std::string>& names = {});

}  // namespace palpate::app
