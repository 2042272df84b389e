#include "palpate/device/registry.h"

#include <algorithm>
#include <utility>

namespace palpate {

void DeviceRegistry::add(DeviceMaker maker) {
  PALPATE_CHECK(!maker.name.empty() && find(maker.name) == nullptr);
  makers_.push_back(std::move(maker));
}

const DeviceMaker* DeviceRegistry::find(const std::string& name) const {
  const auto found = std::ranges::find(makers_, name, &DeviceMaker::name);
  return found == makers_.end() ? nullptr : &*found;
}

}  // namespace palpate
