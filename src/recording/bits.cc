#include "recording/bits.h"

#include <cstdint>

#include "palpate/device.h"
#include "palpate/force_method.h"
#include "palpate/telemetry.h"

// Without a default, so that the compiler names a bit that was added elsewhere and has no name here.
namespace palpate::internal {
namespace {

const char* name_of(TickFlag flag) {
  switch (flag) {
    case kFlagClamped:
      return "clamped";
    case kFlagNotFinite:
      return "not finite";
    case kFlagOutside:
      return "outside";
    case kFlagPaused:
      return "paused";
    case kFlagContact:
      return "contact";
    case kFlagRotationIgnored:
      return "rotation ignored";
    case kFlagThermal:
      return "thermal";
    case kFlagSlew:
      return "slewed";
    case kFlagRamp:
      return "ramp";
    case kFlagStale:
      return "stale";
    case kFlagJump:
      return "jumped";
    case kFlagDeviceFault:
      return "device fault";
    case kFlagHalted:
      return "halted";
    case kFlagEmergencyStop:
      return "emergency stop";
    case kFlagClutched:
      return "clutched";
    case kFlagBlend:
      return "blend";
    case kFlagMethodMissing:
      return "method missing";
    case kFlagInside:
      return "inside";
    case kFlagWedged:
      return "wedged";
    case kFlagRuptured:
      return "ruptured";
    case kFlagPassivity:
      return "passivity";
  }
  return nullptr;
}

const char* name_of(TickSwitch one) {
  switch (one) {
    case kSwitchFriction:
      return "friction";
    case kSwitchViscosity:
      return "viscosity";
    case kSwitchPaused:
      return "paused";
    case kSwitchEmergencyStop:
      return "emergency stop";
    case kSwitchPassivity:
      return "passivity";
  }
  return nullptr;
}

const char* name_of(DeviceStatus status) {
  switch (status) {
    case kDeviceFault:
      return "fault";
    case kDeviceClutched:
      return "clutched";
    case kDeviceHalted:
      return "halted";
  }
  return nullptr;
}

template <class Bits>
std::string text_of_all() {
  std::string text;
  for (std::size_t bit = 0; bit < 8 * sizeof(Bits); ++bit) {
    const std::uint32_t value = std::uint32_t{1} << bit;
    if (const char* name = name_of(static_cast<Bits>(value)))
      text += (text.empty() ? "" : ", ") + std::to_string(value) + " " + name;
  }
  return text;
}

}  // namespace

std::string flag_bits() {
  return text_of_all<TickFlag>();
}
std::string switch_bits() {
  return text_of_all<TickSwitch>();
}
std::string status_bits() {
  return text_of_all<DeviceStatus>();
}

std::string method_numbers() {
  std::string text;
  for (const ForceMethodInfo& info : kForceMethods)
    text += (text.empty() ? "" : ", ") + std::to_string(static_cast<int>(info.method)) + " " +
            std::string(info.name);
  return text;
}

}  // namespace palpate::internal
