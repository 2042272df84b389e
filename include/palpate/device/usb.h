#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "palpate/device/registry.h"

/// USB devices as the operating system reports them, independent of the vendors' libraries.
namespace palpate {

/// A connected USB device.
struct UsbDevice {
  std::uint16_t vendor = 0, product = 0;
  std::string name;            ///< Product name that the device reports
  std::filesystem::path node;  ///< Device node under /dev/bus/usb
  bool may_use = false;        ///< This account may read and write the node
};

/// Connected USB devices of one vendor, sorted by node.
/// @param product  product id; 0: any of the vendor's
/// @param root     parent of /sys and /dev, for tests
std::vector<UsbDevice> usb_devices(std::uint16_t vendor, std::uint16_t product = 0,
                                   const std::filesystem::path& root = "/");

/// One check per connected device, with the udev rules as remedy if this account may not use it; a single
/// failed check if none is connected.
/// @param what  description of the device, e.g. "a device of Force Dimension's"
std::vector<DeviceCheck> usb_checks(const std::vector<UsbDevice>& plugged, const std::string& what);

/// Commands for a technician that let the group `haptics` use the supported devices: they install
/// data/system/60-palpate-haptics.rules.
std::string udev_remedy();

}  // namespace palpate
