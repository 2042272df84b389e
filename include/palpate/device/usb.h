#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "palpate/device/registry.h"

/// What is plugged in, as the system sees it, whatever a maker's library says.
namespace palpate {

struct UsbDevice {
  std::uint16_t vendor = 0, product = 0;
  std::string name;            ///< as it calls itself
  std::filesystem::path node;  ///< under /dev/bus/usb
  bool may_use = false;        ///< this account may read and write it
};

/// @param product  0: any of the vendor's
/// @param root     where /sys and /dev are, for tests
std::vector<UsbDevice> usb_devices(std::uint16_t vendor, std::uint16_t product = 0,
                                   const std::filesystem::path& root = "/");

/// A line for each that is plugged in, with the rule that lets an account use it; one that says so where none
/// is.
/// @param what  "a device of Force Dimension's"
std::vector<DeviceCheck> usb_checks(const std::vector<UsbDevice>& plugged, const std::string& what);

/// What a technician enters so that the group `haptics` may use devices that palpate drives: it installs
/// data/system/60-palpate-haptics.rules.
std::string udev_cure();

}  // namespace palpate
