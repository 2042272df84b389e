#pragma once

#include <Eigen/Geometry>

#include <array>
#include <bit>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "palpate/base/contact_properties.h"
#include "palpate/base/force_method.h"

/// Settings of a session that viewers may change while it runs, with their description. Viewer messages and
/// their errors, permissions, consent texts, recordings, replay and the page's types are derived from the
/// tables below.
namespace palpate {

/// Bits of TickRecord::switches.
enum TickSwitch : std::uint8_t {
  kSwitchFriction = 1u << 0,
  kSwitchViscosity = 1u << 1,
  kSwitchPaused = 1u << 2,
  kSwitchEmergencyStop = 1u << 3,  ///< Not a setting: the emergency stop has requests of its own
  kSwitchPassivity = 1u << 4,
  kSwitchMotor = 1u << 5,
  kSwitchVibration = 1u << 6,
};

/// Settings changed by a request. Bits of RecordingEvent::changed.
enum SettingBit : std::uint16_t {
  kSettingMethod = 1u << 0,
  kSettingFriction = 1u << 1,
  kSettingViscosity = 1u << 2,
  kSettingPassivity = 1u << 3,
  kSettingPaused = 1u << 4,
  kSettingMaxForce = 1u << 5,
  kSettingRotation = 1u << 6,
  /// Pointer taken or released by a viewer, alternately, since one viewer has it at a time; not a setting
  kSettingPointer = 1u << 7,
  kSettingMotor = 1u << 8,
  kSettingVibration = 1u << 9,
};

/// Settings that are on or off.
struct Switches {
  bool friction = true;
  bool viscosity = true;
  /// Damp contacts that have returned more energy than they received; the observer runs in any case
  bool passivity = true;
  bool paused = false;  ///< Fade the forces out and keep them off
  /// Motor switch of cutting tools, combined (or) with the pedal; the motor stops while no force is sent
  bool motor = false;
  /// Render the vibration and the tangential kick of a running burr (palpate/servo/burr_rendering.h)
  bool vibration = false;
};
/// Requested states of some switches.
struct SwitchChanges {
  std::optional<bool> friction, viscosity, passivity, paused, motor, vibration;
};

/// All settings that a tick reads.
struct Settings : Switches {
  /// Force method; falls back to trilinear if the model is not prepared for it (kFlagMethodMissing).
  ForceMethod method = ForceMethod::kTrilinear;
  /// The user's force limit, applied together with the scene's; negative or non-finite counts as 0
  double max_force_N = 3.0;
  /// Commanded rotation of the object about World's origin; updated about 10 times a second.
  Eigen::Quaterniond rotation_target = Eigen::Quaterniond::Identity();
};
/// Requested values of some settings, as messages have them.
struct SettingsChanges : SwitchChanges {
  std::optional<std::string> method;
  std::optional<std::string> law;  ///< Law of soft tissue; a property of the model, not a tick input
  std::optional<double> max_force_N;
  std::optional<std::array<double, 4>> rotation_wxyz;
};

/// Description of a switch.
struct SwitchInfo {
  bool Switches::*value;
  std::optional<bool> SwitchChanges::*change;
  std::string_view name;   ///< In messages and recordings
  std::string_view about;  ///< Clause for the manual: what is the case while the switch is on
  /// Consent texts for switching it off, and on.
  std::array<std::string_view, 2> consent;
  TickSwitch recorded;
  SettingBit changed;
  bool is_haptic;   ///< Whether a viewer needs the permission to change haptic properties
  bool is_blended;  ///< Whether a change is blended in; the state hash contains those switches
  /// State that may increase the force or release a restriction: consent to it is also needed after a stop.
  bool riskier_value;
};

/// All switches.
inline constexpr std::array<SwitchInfo, 6> kSwitches{
    {{.value = &Switches::friction,
      .change = &SwitchChanges::friction,
      .name = "friction",
      .about = "friction is rendered",
      .consent = {"switch friction off", "switch friction on"},
      .recorded = kSwitchFriction,
      .changed = kSettingFriction,
      .is_haptic = true,
      .is_blended = true,
      .riskier_value = true},
     {.value = &Switches::viscosity,
      .change = &SwitchChanges::viscosity,
      .name = "viscosity",
      .about = "viscosity is rendered",
      .consent = {"switch viscosity off", "switch viscosity on"},
      .recorded = kSwitchViscosity,
      .changed = kSettingViscosity,
      .is_haptic = true,
      .is_blended = true,
      .riskier_value = true},
     {.value = &Switches::passivity,
      .change = &SwitchChanges::passivity,
      .name = "passivity",
      .about = "the passivity controller may act",
      .consent = {"switch the passivity controller off", "switch the passivity controller on"},
      .recorded = kSwitchPassivity,
      .changed = kSettingPassivity,
      .is_haptic = true,
      .is_blended = true,
      .riskier_value = false},
     {.value = &Switches::paused,
      .change = &SwitchChanges::paused,
      .name = "paused",
      .about = "the session is paused",
      .consent = {"resume the force", "pause the force"},
      .recorded = kSwitchPaused,
      .changed = kSettingPaused,
      .is_haptic = false,
      .is_blended = false,
      .riskier_value = false},
     {.value = &Switches::motor,
      .change = &SwitchChanges::motor,
      .name = "motor",
      .about = "the motors of cutting tools are switched on",
      .consent = {"switch the tool's motor off", "switch the tool's motor on"},
      .recorded = kSwitchMotor,
      .changed = kSettingMotor,
      .is_haptic = false,
      .is_blended = false,
      .riskier_value = true},
     {.value = &Switches::vibration,
      .change = &SwitchChanges::vibration,
      .name = "vibration",
      .about = "the vibration and the kick of a running burr are rendered",
      .consent = {"switch the burr's vibration off", "switch the burr's vibration on"},
      .recorded = kSwitchVibration,
      .changed = kSettingVibration,
      .is_haptic = true,
      .is_blended = true,
      .riskier_value = true}}};

/// Whether the table lists all switches, each with texts, and with bits of its own.
constexpr bool lists_every_switch() {
  std::uint32_t recorded = kSwitchEmergencyStop, changed = kSettingPointer;
  for (std::size_t n = 0; n < kSwitches.size(); ++n) {
    Switches one;
    SwitchChanges change;
    for (const SwitchInfo& other : kSwitches) one.*other.value = false;
    one.*kSwitches[n].value = true;
    change.*kSwitches[n].change = true;
    for (std::size_t other = 0; other < kSwitches.size(); ++other)
      if (one.*kSwitches[other].value != (other == n) ||
          (change.*kSwitches[other].change).has_value() != (other == n))
        return false;
    const SwitchInfo& info = kSwitches[n];
    if (!std::has_single_bit(unsigned{info.recorded}) || (recorded & info.recorded) != 0) return false;
    if (!std::has_single_bit(unsigned{info.changed}) || (changed & info.changed) != 0) return false;
    if (info.name.empty() || info.about.empty() || info.consent[0].empty() || info.consent[1].empty())
      return false;
    recorded |= info.recorded;
    changed |= info.changed;
  }
  return sizeof(Switches) == kSwitches.size() * sizeof(bool) &&
         sizeof(SwitchChanges) == kSwitches.size() * sizeof(std::optional<bool>);
}
static_assert(lists_every_switch());

/// Description of a setting that is not a switch.
template <class Value, class Change>
struct SettingInfo {
  Value Settings::*value;
  std::optional<Change> SettingsChanges::*change;
  std::string_view name;   ///< In messages
  std::string_view words;  ///< In recordings
  std::string_view about;  ///< In the manual
  SettingBit changed;
  bool is_haptic;  ///< As SwitchInfo::is_haptic
};
inline constexpr SettingInfo<ForceMethod, std::string> kMethodSetting{
    &Settings::method,  &SettingsChanges::method, "method", "method",
    "the force method", kSettingMethod,           true};
inline constexpr SettingInfo<double, double> kMaxForceSetting{&Settings::max_force_N,
                                                              &SettingsChanges::max_force_N,
                                                              "max_force_N",
                                                              "force limit",
                                                              "the user's limit",
                                                              kSettingMaxForce,
                                                              true};
inline constexpr SettingInfo<Eigen::Quaterniond, std::array<double, 4>> kRotationSetting{
    &Settings::rotation_target,
    &SettingsChanges::rotation_wxyz,
    "rotation_wxyz",
    "rotation",
    "the commanded rotation of the object",
    kSettingRotation,
    false};
/// Range that no force limit of a scene or a user exceeds; N.
inline constexpr ValueRange kMaxForceRange{0.1, 40};
/// Name of SettingsChanges::law in messages.
inline constexpr std::string_view kLawSetting = "law";

/// Calls `visit` with the description of every setting that a tick reads.
template <class Visit>
constexpr void visit_settings(Visit&& visit) {
  visit(kMethodSetting);
  for (const SwitchInfo& info : kSwitches) visit(info);
  visit(kMaxForceSetting);
  visit(kRotationSetting);
}

/// Values of settings as messages have them.
constexpr bool message_value(bool value) {
  return value;
}
constexpr double message_value(double value) {
  return value;
}
inline std::string message_value(ForceMethod method) {
  return std::string(name_of(method));
}
inline std::array<double, 4> message_value(const Eigen::Quaterniond& q) {
  return {q.w(), q.x(), q.y(), q.z()};
}

/// TickSwitch bits of the switches.
constexpr std::uint8_t switch_bits(const Switches& switches) {
  unsigned bits = 0;
  for (const SwitchInfo& info : kSwitches)
    if (switches.*info.value) bits |= info.recorded;
  return static_cast<std::uint8_t>(bits);
}
/// TickSwitch bits of the switches whose changes are blended in.
constexpr std::uint8_t blended_switch_bits(const Switches& switches) {
  unsigned bits = 0;
  for (const SwitchInfo& info : kSwitches)
    if (info.is_blended && switches.*info.value) bits |= info.recorded;
  return static_cast<std::uint8_t>(bits);
}
/// Applies requested values. The method is left to the session, which may have to prepare it, and so is the
/// law. Rotations are normalised.
void apply_changes(const SettingsChanges& changes, Settings& settings);
/// SettingBit bits of the settings that differ.
std::uint16_t changed_settings(const Settings& before, const Settings& after);

/// Stores the settings in a record: a TickRecord or a RecordingEvent.
template <class Record>
void record_settings(const Settings& settings, Record& record) {
  record.method = static_cast<std::uint8_t>(settings.method);
  record.switches = switch_bits(settings);
  record.max_force_N = settings.max_force_N;
  record.rotation_target_wxyz = message_value(settings.rotation_target);
}
/// Settings stored by record_settings(). The method is not checked.
template <class Record>
Settings recorded_settings(const Record& record) {
  Settings settings;
  settings.method = static_cast<ForceMethod>(record.method);
  for (const SwitchInfo& info : kSwitches) settings.*info.value = (record.switches & info.recorded) != 0;
  settings.max_force_N = record.max_force_N;
  const auto& [w, x, y, z] = record.rotation_target_wxyz;
  settings.rotation_target = {w, x, y, z};
  return settings;
}

}  // namespace palpate
