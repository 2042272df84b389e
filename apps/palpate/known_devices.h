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

/// What a user says about a tracker's stream.
struct StreamOptions {
  std::string transform, reference;  ///< as TrackerSettings has them
  std::filesystem::path tip;         ///< what palpate pivot has written
};
/// `--transform`, `--reference`.
void add_stream_options(CLI::App& verb, StreamOptions& options);
/// `--tip`.
void add_tip_option(CLI::App& verb, StreamOptions& options);
/// Errors: those of reading the file, of parse_tip().
Result<ToolTip> read_tip(const std::filesystem::path& file);

/// What a user says about devices, as NAME=VALUE each, and about a tracked tool.
struct DeviceOptions {
  std::vector<std::string> libraries;    ///< the file of a maker's library
  std::vector<std::string> held_masses;  ///< kg that is held at a device's end
  /// a name by which its maker's setup knows a device, several of one maker
  std::vector<std::string> configs;
  std::string tracker;  ///< HOST:PORT
  StreamOptions stream;
  std::filesystem::path registration;  ///< what palpate register has written
};
/// `--library`, `--held-mass`, `--device-config`, `--tracker`.
void add_device_options(CLI::App& verb, DeviceOptions& options);

/// The tracked tool of which a user says where it is and how it is registered; null: of none.
/// Errors: kUsage where something of it is not said, and those of its files.
Result<std::shared_ptr<const Navigation>> navigation_of(const DeviceOptions& options);

/// The drivers that this program has: whoever adds one adds it here, and nowhere else.
/// @param navigation  of the tracked tool, which can be felt with then
/// Errors: kUsage for a name that is none, or a value that is none.
Result<DeviceRegistry> known_devices(const DeviceOptions& options = {},
                                     const std::shared_ptr<const Navigation>& navigation = nullptr);

}  // namespace palpate::app
