#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "palpate/device/device.h"
#include "palpate/device/registry.h"

namespace palpate {

/// A plug-in, and the program that runs it.
struct PluginSettings {
  std::filesystem::path file;  ///< Shared library that exports plp_driver_v1() (include/palpate_driver.h)
  /// Program and arguments that call serve_plugin() with the arguments appended to them
  std::vector<std::string> command;
};

/// Driver of devices by a plug-in, which runs in a process of its own: DeviceInfo::Drive::kPulled.
///
///     servo thread         read request ──► plug-in's process: read()     |  watchdog of that process:
///                          ◄── samples                                    |  halt() when a call or the
///       tick               commands ──────► write()                       |  session takes kSilence_s
///
/// **Fault handling**: a plug-in whose process ends, that gives no sample for kAbandoned_s, or reports one
/// that is not finite or of another size is given up: samples are marked `fault` from then on, its process
/// halts the device and is killed kHaltPatience_s later, and failure() states the reason. A session that dies
/// or stands still is silent, and its device gets zero force.
class PluginDriver final : public DeviceDriver {
 public:
  explicit PluginDriver(const PluginSettings& settings);
  ~PluginDriver() override;

  std::span<const DeviceInfo> devices() const override;
  /// Errors: kUnavailable if the plug-in cannot be loaded or its device does not answer; kUsage if an arm
  /// would move by itself without consent.
  Result<void> open(bool may_move) override;
  void run(ServoFunction& servo, ServoClock& clock) noexcept override;
  void halt() noexcept override;
  void resume(std::uint64_t newest) noexcept override;
  std::optional<Error> failure() const override;

  /// Loads a plug-in in a process of its own, connects to nothing, and reports its devices.
  static DeviceReport probe(const PluginSettings& settings);

  /// Timeout of a sample, after which the tick uses the previous one, whose age increases.
  static constexpr double kTimeout_s = 0.002;
  /// Duration of a plug-in's call, or of the session's silence, after which the plug-in has to halt.
  static constexpr double kSilence_s = 0.009;
  /// Time without a sample after which the plug-in is given up.
  static constexpr double kAbandoned_s = 0.1;
  /// Time that the process of a plug-in that was given up has for halting its device before it is killed. It
  /// needs a millisecond, and longer on a busy processor.
  static constexpr double kHaltPatience_s = 0.05;

 private:
  class Core;
  std::unique_ptr<Core> core_;
};

/// Beginning of the name of a plug-in's device: `--device plugin=FILE`.
inline constexpr const char* kPluginPrefix = "plugin=";

/// The device option `--device plugin=FILE`.
DeviceVendor plugin_vendor(const PluginSettings& settings);

/// Main function of a plug-in's process, which PluginDriver starts; returns its exit code.
/// @param arguments  arguments that PluginDriver appended to the command
int serve_plugin(const std::vector<std::string>& arguments);

}  // namespace palpate
