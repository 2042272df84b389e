#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "palpate/device/device.h"

/// The devices that a program knows, by name: whoever links a driver adds its maker, and nobody lists them
/// all anywhere else.
namespace palpate {

/// One thing that a driver needs, looked for without moving or arming anything.
struct DeviceCheck {
  std::string what;  ///< "service at 127.0.0.1:10001"
  bool fine = false;
  std::string found;  ///< what is there, or exactly what is missing
  std::string cure;   ///< what a technician does about it; empty where it is fine
};

/// A device that is there.
struct ConnectedDevice {
  std::string id;     ///< by which its maker tells it from others of its kind
  std::string state;  ///< "ready", or what it waits for
};

struct DeviceReport {
  std::vector<DeviceCheck> checks;
  std::vector<ConnectedDevice> connected;
};

struct DeviceMaker {
  std::string name;  ///< as `--device` has it: lower-case letters, digits and hyphens
  std::string what;  ///< in a line
  /// A driver that is not connected yet: open() does that.
  std::function<std::unique_ptr<DeviceDriver>()> make;
  /// What there is of it on this machine. Takes some seconds at most.
  std::function<DeviceReport()> look;
};

class DeviceRegistry {
 public:
  /// A name that is there already is a bug.
  void add(DeviceMaker maker);
  const std::vector<DeviceMaker>& all() const { return makers_; }
  /// nullptr: there is none of that name.
  const DeviceMaker* find(const std::string& name) const;

 private:
  std::vector<DeviceMaker> makers_;
};

}  // namespace palpate
