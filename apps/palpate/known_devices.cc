#include "known_devices.h"

#include "palpate/haply/haply_driver.h"

namespace palpate::app {

DeviceRegistry known_devices() {
  DeviceRegistry registry;
  registry.add(haply_maker());
  return registry;
}

}  // namespace palpate::app
