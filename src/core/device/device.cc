#include "palpate/device/device.h"

#include <numbers>

namespace palpate {

Rotation<World, Device> openhaptics_axes() {
  return Rotation<World, Device>::about(Eigen::Vector3d::UnitX(), std::numbers::pi / 2);
}

Rotation<World, Device> force_dimension_axes() {
  return Rotation<World, Device>::about(Eigen::Vector3d::UnitZ(), -std::numbers::pi / 2);
}

Rotation<World, Device> haply_axes() {
  return {};
}

Result<void> require_consent(const DeviceInfo& info, bool may_move) {
  if (may_move || !info.moves_by_itself) return {};
  return Error{ErrorKind::kUsage, "the arm of " + info.name + " moves by itself to calibrate", info.name,
               "clear the space around it and keep your hands away, then allow it to move"};
}

}  // namespace palpate
