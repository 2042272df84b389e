#include "recording/bits.h"

#include <algorithm>
#include <cstdint>
#include <string_view>

#include "palpate/base/force_method.h"
#include "palpate/device/device.h"
#include "palpate/device/session_settings.h"
#include "palpate/recording/recording.h"

// The switches have no default, so that the compiler reports a new enumerator without a name.
namespace palpate::internal {
namespace {

std::string_view name_of(TickFlag flag) {
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
    case kFlagRotationLimited:
      return "turn held";
    case kFlagNoGo:
      return "no-go region";
    case kFlagRelease:
      return "release";
    case kFlagBreakThrough:
      return "break-through";
  }
  return {};
}

std::string_view name_of(TickSwitch bit) {
  if (bit == kSwitchEmergencyStop) return "emergency stop";
  const auto found = std::ranges::find(kSwitches, bit, &SwitchInfo::recorded);
  return found == kSwitches.end() ? std::string_view() : found->name;
}

std::string_view name_of(DeviceStatus status) {
  switch (status) {
    case kDeviceFault:
      return "fault";
    case kDeviceClutched:
      return "clutched";
    case kDeviceHalted:
      return "halted";
    case kDeviceSetDown:
      return "set down";
  }
  return {};
}

// in recordings a switch has the name that it has in messages
std::string_view words_of(const SwitchInfo& info) {
  return info.name;
}
template <class Value, class Change>
std::string_view words_of(const SettingInfo<Value, Change>& info) {
  return info.words;
}

std::string_view name_of(SettingBit bit) {
  if (bit == kSettingPointer) return "tip taken or released";
  std::string_view name;
  visit_settings([&](const auto& setting) {
    if (setting.changed == bit) name = words_of(setting);
  });
  return name;
}

std::string_view name_of(RecordingEvent::Kind kind) {
  switch (kind) {
    case RecordingEvent::Kind::kModel:
      return "model";
    case RecordingEvent::Kind::kSettings:
      return "settings";
    case RecordingEvent::Kind::kStop:
      return "stop";
    case RecordingEvent::Kind::kRearm:
      return "rearm";
    case RecordingEvent::Kind::kSweep:
      return "sweep";
    case RecordingEvent::Kind::kTissueSolution:
      return "tissue solved";
  }
  return {};
}

std::string_view name_of(Originator originator) {
  switch (originator) {
    case Originator::kSession:
      return "the session itself";
    case Originator::kScript:
      return "script";
    case Originator::kKey:
      return "key";
    case Originator::kControlViewer:
      return "viewer with control";
    case Originator::kViewingViewer:
      return "viewer with view";
    case Originator::kViewerWithConsent:
      return "viewer with control, accepted by a key";
  }
  return {};
}

template <class Bits>
std::string list_of_bits() {
  std::string text;
  for (std::size_t bit = 0; bit < 8 * sizeof(Bits); ++bit) {
    const std::uint32_t value = std::uint32_t{1} << bit;
    if (const std::string_view name = name_of(static_cast<Bits>(value)); !name.empty())
      text += (text.empty() ? "" : ", ") + std::to_string(value) + " " + std::string(name);
  }
  return text;
}

template <class Numbered>
std::string list_of_values() {
  std::string text;
  for (std::uint8_t number = 0;; ++number) {
    const std::string_view name = name_of(static_cast<Numbered>(number));
    if (name.empty()) return text;
    text += (text.empty() ? "" : ", ") + std::to_string(number) + " " + std::string(name);
  }
}

}  // namespace

std::string flag_bits() {
  return list_of_bits<TickFlag>();
}
std::string switch_bits() {
  return list_of_bits<TickSwitch>();
}
std::string status_bits() {
  return list_of_bits<DeviceStatus>();
}

std::string setting_bits() {
  return list_of_bits<SettingBit>();
}
std::string event_kinds() {
  return list_of_values<RecordingEvent::Kind>();
}
std::string originators() {
  return list_of_values<Originator>();
}

std::string method_numbers() {
  std::string text;
  for (const ForceMethodInfo& info : kForceMethods)
    text += (text.empty() ? "" : ", ") + std::to_string(static_cast<int>(info.method)) + " " +
            std::string(info.name);
  return text;
}

}  // namespace palpate::internal
