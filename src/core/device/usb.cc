#include "palpate/device/usb.h"

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <optional>
#include <system_error>

#include "palpate/base/printable.h"

namespace palpate {
namespace {

std::string first_line(const std::filesystem::path& file) {
  std::ifstream in(file);
  std::string line;
  std::getline(in, line);
  return line;
}

std::optional<unsigned long> number_in(const std::filesystem::path& file, int base) {
  const std::string text = first_line(file);
  char* end = nullptr;
  const unsigned long number = std::strtoul(text.c_str(), &end, base);
  if (text.empty() || end == text.c_str()) return std::nullopt;
  return number;
}

}  // namespace

std::vector<UsbDevice> usb_devices(std::uint16_t vendor, std::uint16_t product,
                                   const std::filesystem::path& root) {
  std::vector<UsbDevice> found;
  std::error_code failed;
  for (std::filesystem::directory_iterator it(root / "sys/bus/usb/devices", failed), end;
       !failed && it != end; it.increment(failed)) {
    const auto& folder = it->path();
    const auto its_vendor = number_in(folder / "idVendor", 16),
               its_product = number_in(folder / "idProduct", 16);
    if (its_vendor != vendor || !its_product || (product != 0 && its_product != product)) continue;
    UsbDevice device{vendor,
                     static_cast<std::uint16_t>(*its_product),
                     printable_name(first_line(folder / "product")),
                     {},
                     false};
    const auto bus = number_in(folder / "busnum", 10), number = number_in(folder / "devnum", 10);
    if (bus && number) {
      char node[32];
      std::snprintf(node, sizeof node, "%03lu/%03lu", *bus % 1000, *number % 1000);
      device.node = root / "dev/bus/usb" / node;
      device.may_use = ::access(device.node.c_str(), R_OK | W_OK) == 0;
    }
    found.push_back(device);
  }
  std::ranges::sort(found, {}, &UsbDevice::node);
  return found;
}

std::vector<DeviceCheck> usb_checks(const std::vector<UsbDevice>& plugged, const std::string& what) {
  if (plugged.empty()) return {{what + " by USB", false, "none is plugged in", "plug it in and power it"}};
  std::vector<DeviceCheck> checks;
  for (const UsbDevice& device : plugged) {
    const std::string name = device.name.empty() ? what : device.name;
    checks.push_back({name + " by USB", device.may_use,
                      device.may_use ? "plugged in (" + device.node.string() + ")"
                                     : "plugged in, but this account may not use " + device.node.string(),
                      device.may_use ? "" : udev_remedy()});
  }
  return checks;
}

std::string udev_remedy() {
  return "an administrator installs the rules included with palpate, once:\n"
         "  sudo groupadd -f haptics\n"
         "  sudo usermod -aG haptics NAME (the account that palpate is started from)\n"
         "  sudo cp 60-palpate-haptics.rules /etc/udev/rules.d/ (in data/system, or share/palpate/system)\n"
         "  sudo udevadm control --reload && sudo udevadm trigger\n"
         "then log out and in again, and reconnect the device";
}

}  // namespace palpate
