#include "known_devices.h"


namespace palpate::app {

DeviceRegistry known_devices() {
  DeviceRegistry registry;
  return registry;
}

}  // namespace palpate::app
