#include "palpate/device/registry.h"

#include <algorithm>
#include <utility>

namespace palpate {

void DeviceRegistry::add(DeviceVendor vendor) {
  PALPATE_CHECK(!vendor.name.empty() && find(vendor.name) == nullptr);
  vendors_.push_back(std::move(vendor));
}

const DeviceVendor* DeviceRegistry::find(const std::string& name) const {
  const auto found = std::ranges::find(vendors_, name, &DeviceVendor::name);
  return found == vendors_.end() ? nullptr : &*found;
}

}  // namespace palpate
