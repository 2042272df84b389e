#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "palpate/device/device.h"

/// Registry of the devices that a program supports, by name. The program that links a driver registers its
/// vendor; there is no other list.
namespace palpate {

/// Result of checking one prerequisite of a driver, without moving or arming anything.
struct DeviceCheck {
  std::string what;  ///< Prerequisite, e.g. "service at 127.0.0.1:10001"
  bool passed = false;
  std::string found;   ///< State found, or exactly what is missing
  std::string remedy;  ///< Remedy for a technician; empty if the check passed
};

/// A connected device.
struct ConnectedDevice {
  std::string id;     ///< Identifier by which the vendor distinguishes devices of one kind
  std::string state;  ///< "ready", or what it is waiting for
};

/// Availability of one vendor's devices on this machine.
struct DeviceReport {
  std::vector<DeviceCheck> checks;
  std::vector<ConnectedDevice> connected;
};

/// A vendor's device kind and how to create and probe it.
struct DeviceVendor {
  std::string name;  ///< Name for `--device`: lower-case letters, digits and hyphens
  std::string what;  ///< One-line description
  /// Creates a driver that is not connected; DeviceDriver::open() connects it.
  std::function<std::unique_ptr<DeviceDriver>()> make;
  /// Reports prerequisites and connected devices on this machine. Takes some seconds at most.
  std::function<DeviceReport()> detect;
};

/// Registered vendors, in the order of registration.
class DeviceRegistry {
 public:
  /// Registers a vendor. A name that is already registered is a bug.
  void add(DeviceVendor vendor);
  const std::vector<DeviceVendor>& all() const { return vendors_; }
  /// Vendor of that name; nullptr if there is none.
  const DeviceVendor* find(const std::string& name) const;

 private:
  std::vector<DeviceVendor> vendors_;
};

}  // namespace palpate
