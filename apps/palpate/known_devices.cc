#include "known_devices.h"

#include <algorithm>
#include <cstdlib>
#include <map>
#include <optional>
#include <string_view>

#include "palpate/base/file.h"
#include "palpate/base/printable.h"
#include "palpate/device/telemetry.h"
#include "palpate/force_dimension/force_dimension_driver.h"
#include "palpate/haply/haply_driver.h"
#include "palpate/navigation/result_files.h"
#include "palpate/openhaptics/openhaptics_driver.h"
#include "palpate/plugin/plugin_driver.h"
#include "palpate/spacemouse/spacemouse_driver.h"
#include "palpate/tracker/tracker_driver.h"

namespace palpate::app {
namespace {

/// Values of an option of the form NAME=VALUE; each name once unless `repeats`.
class NamedValues {
 public:
  static Result<NamedValues> parse(const char* option, const std::vector<std::string>& declared,
                                   const std::vector<std::string>& names, bool repeats = false) {
    NamedValues named;
    std::string all;
    for (const std::string& name : names) all += (all.empty() ? "" : ", ") + name;
    for (const std::string& each : declared) {
      const std::size_t equals = each.find('=');
      const std::string name = each.substr(0, equals);
      if (equals == std::string::npos || equals + 1 == each.size())
        return Error{ErrorKind::kUsage, "'" + each + "' is not NAME=VALUE", option, "NAME is one of: " + all};
      if (std::find(names.begin(), names.end(), name) == names.end())
        return Error{ErrorKind::kUsage, "there is no such setting for '" + name + "'", option,
                     "it exists for: " + all};
      named.all_.push_back(each.substr(equals + 1));
      if (repeats) continue;
      if (!named.values_.emplace(name, each.substr(equals + 1)).second)
        return Error{ErrorKind::kUsage, "'" + name + "' is named twice", option, "name each device once"};
    }
    return named;
  }
  /// All values in order, for an option whose names may repeat.
  const std::vector<std::string>& all() const { return all_; }
  std::string text(const std::string& name) const {
    const auto found = values_.find(name);
    return found == values_.end() ? "" : found->second;
  }
  /// Value as a number; empty if it is not given. Errors: kUsage if it is not a number from 0 to `largest`.
  Result<std::optional<double>> number(const char* option, const std::string& name, double largest) const {
    const std::string declared = text(name);
    if (declared.empty()) return std::optional<double>();
    char* end = nullptr;
    const double value = std::strtod(declared.c_str(), &end);
    if (*end != '\0' || !(value >= 0 && value <= largest))
      return Error{ErrorKind::kUsage,
                   "'" + declared + "' is not a number from 0 to " + std::to_string(largest), option,
                   "give the mass of the tool at the end of the arm in kilograms"};
    return std::optional<double>(value);
  }

 private:
  std::map<std::string, std::string> values_;
  std::vector<std::string> all_;
};

constexpr double kMaxHeld_kg = 1;
constexpr std::size_t kMaxResult_bytes = std::size_t{1} << 24;

// address of the tracker; empty if it is not given
Result<TrackerAddress> tracker_of(const DeviceOptions& options) {
  if (options.tracker.empty()) return TrackerAddress{};
  const auto address = parse_tracker_address(options.tracker);
  if (address) return *address;
  return Error{ErrorKind::kUsage, "'" + printable_name(options.tracker) + "' is not an address", "--tracker",
               "write HOST:PORT, such as 192.168.0.7:18944"};
}

}  // namespace

void add_stream_options(CLI::App& verb, StreamOptions& options) {
  verb.add_option("--transform", options.transform,
                  "Name of the transform of the tool's markers in a tracker's stream or a recorded sequence, "
                  "e.g. StylusToTracker");
  verb.add_option("--reference", options.reference,
                  "Name of the transform of the patient's markers in a tracker's stream, e.g. "
                  "ReferenceToTracker; the patient may then move");
}

void add_tip_option(CLI::App& verb, StreamOptions& options) {
  verb.add_option("--tip", options.tip, "Position of the tool's tip, as written by palpate pivot -o");
}

Result<ToolTip> read_tip(const std::filesystem::path& file) {
  const auto text = read_file(file, kMaxResult_bytes);
  if (!text) return text.error();
  return parse_tip(*text, file.string());
}

void add_device_options(CLI::App& verb, DeviceOptions& options) {
  verb.add_option("--library", options.libraries,
                  "NAME=FILE: library of the device's vendor; default: searched for in the system's folders "
                  "(docs/reference/devices.md)")
      ->allow_extra_args(false);
  verb.add_option(
          "--held-mass", options.held_masses,
          "NAME=KG: mass of a custom tool at the end of the device, whose weight the device compensates")
      ->allow_extra_args(false);
  verb.add_option("--device-config", options.configs,
                  "touch=NAME: name of the device in the vendor's configuration; may be repeated; default: "
                  "the default device")
      ->allow_extra_args(false);
  verb.add_option("--tracker", options.tracker,
                  "HOST:PORT of a tracking server (OpenIGTLink; port 18944 for PLUS)");
}

Result<std::shared_ptr<const Navigation>> navigation_of(const DeviceOptions& options) {
  const StreamOptions& stream = options.stream;
  if (options.tracker.empty() && stream.transform.empty() && stream.reference.empty() && stream.tip.empty() &&
      options.registration.empty())
    return std::shared_ptr<const Navigation>();
  const std::pair<const char*, bool> needed[] = {{"--tracker", !options.tracker.empty()},
                                                 {"--transform", !stream.transform.empty()},
                                                 {"--tip", !stream.tip.empty()},
                                                 {"--registration", !options.registration.empty()}};
  for (const auto& [option, is_given] : needed)
    if (!is_given)
      return Error{ErrorKind::kUsage, "is missing: a tracked tool needs it", option,
                   "give --tracker, --transform, --tip and --registration (docs/guide/navigation.md)"};
  auto tip = read_tip(stream.tip);
  if (!tip) return tip.error();
  const auto text = read_file(options.registration, kMaxResult_bytes);
  if (!text) return text.error();
  auto patient = parse_registration(*text, options.registration.string());
  if (!patient) return patient.error();
  if (!patient->reference.empty() && patient->reference != stream.reference)
    return Error{ErrorKind::kBadInput,
                 "was made in the coordinates of " + printable_name(patient->reference) + ", not of " +
                     (stream.reference.empty() ? "the tracker" : printable_name(stream.reference)),
                 options.registration.string(),
                 "give --reference " + printable_name(patient->reference) + ", or register again"};
  return std::shared_ptr<const Navigation>(
      std::make_shared<Navigation>(Navigation{*std::move(tip), *std::move(patient)}));
}

Result<DeviceRegistry> known_devices(const DeviceOptions& options,
                                     const std::shared_ptr<const Navigation>& navigation,
                                     const std::vector<std::string>& names) {
  const std::vector<std::string> by_library{"force-dimension", "touch"};
  const auto libraries = NamedValues::parse("--library", options.libraries, by_library);
  if (!libraries) return libraries.error();
  const auto masses = NamedValues::parse("--held-mass", options.held_masses, by_library);
  if (!masses) return masses.error();

  ForceDimensionSettings force_dimension;
  force_dimension.library.file = libraries->text("force-dimension");
  const auto held_kg = masses->number("--held-mass", "force-dimension", kMaxHeld_kg);
  if (!held_kg) return held_kg.error();
  force_dimension.held_mass_kg = *held_kg;

  OpenHapticsSettings openhaptics;
  openhaptics.library.file = libraries->text("touch");
  const auto held_by_touch_kg = masses->number("--held-mass", "touch", kMaxHeld_kg);
  if (!held_by_touch_kg) return held_by_touch_kg.error();
  openhaptics.held_mass_kg = *held_by_touch_kg;
  const auto configs = NamedValues::parse("--device-config", options.configs, {"touch"}, true);
  if (!configs) return configs.error();
  openhaptics.names = configs->all();
  if (openhaptics.names.size() > static_cast<std::size_t>(kMaxDevices))
    return Error{ErrorKind::kUsage, std::to_string(openhaptics.names.size()) + " devices", "--device-config",
                 "a session has " + std::to_string(kMaxDevices) + " at most"};

  const auto address = tracker_of(options);
  if (!address) return address.error();
  TrackedToolSettings tracked{{*address, options.stream.transform, options.stream.reference}, {}};
  if (navigation) tracked.navigation = *navigation;

  DeviceRegistry registry;
  registry.add(haply_vendor());
  registry.add(force_dimension_vendor(force_dimension));
  registry.add(openhaptics_vendor(openhaptics));
  registry.add(spacemouse_vendor());
  registry.add(tracker_vendor(tracked));
  for (const std::string& name : names)
    if (name.starts_with(kPluginPrefix) && registry.find(name) == nullptr)
      registry.add(plugin_vendor(
          {name.substr(std::string_view(kPluginPrefix).size()), {"/proc/self/exe", "serve-plugin"}}));
  return registry;
}

}  // namespace palpate::app
