#include "palpate/device/registry.h"

#include <algorithm>
#include <utility>

namespace palpate {

void DeviceRegistry::add(DeviceVendor maker) {
  PALPATE_CHECK(!maker.name.empty() && find(maker.name) == nullptr);
  makers_.push_back(std::move(maker));
}

const DeviceVendor* DeviceRegistry::find(const std::string& name) const {
  const auto found = std::ranges::find(makers_, name, &DeviceVendor::name);
  return found == makers_.end() ? nullptr : &*found;
}

}  // namespace palpate
