#include "known_devices.h"

#include <algorithm>
#include <cstdlib>
#include <map>
#include <optional>

#include "palpate/device/telemetry.h"
#include "palpate/force_dimension/force_dimension_driver.h"
#include "palpate/haply/haply_driver.h"
#include "palpate/openhaptics/openhaptics_driver.h"
#include "palpate/spacemouse/spacemouse_driver.h"

namespace palpate::app {
namespace {

/// NAME=VALUE of one option, each name once.
class Named {
 public:
  static Result<Named> parse(const char* option, const std::vector<std::string>& said,
                             const std::vector<std::string>& names, bool repeats = false) {
    Named named;
    std::string all;
    for (const std::string& name : names) all += (all.empty() ? "" : ", ") + name;
    for (const std::string& each : said) {
      const std::size_t equals = each.find('=');
      const std::string name = each.substr(0, equals);
      if (equals == std::string::npos || equals + 1 == each.size())
        return Error{ErrorKind::kUsage, "'" + each + "' is not NAME=VALUE", option, "NAME is one of: " + all};
      if (std::find(names.begin(), names.end(), name) == names.end())
        return Error{ErrorKind::kUsage, "there is none for '" + name + "'", option, "there is for: " + all};
      named.all_.push_back(each.substr(equals + 1));
      if (repeats) continue;
      if (!named.values_.emplace(name, each.substr(equals + 1)).second)
        return Error{ErrorKind::kUsage, "'" + name + "' is named twice", option, "name each device once"};
    }
    return named;
  }
  /// In order, where one name may come several times.
  const std::vector<std::string>& all() const { return all_; }
  std::string text(const std::string& name) const {
    const auto found = values_.find(name);
    return found == values_.end() ? "" : found->second;
  }
  /// Errors: kUsage for what is no number from 0 to `most`.
  Result<std::optional<double>> number(const char* option, const std::string& name, double most) const {
    const std::string said = text(name);
    if (said.empty()) return std::optional<double>();
    char* end = nullptr;
    const double value = std::strtod(said.c_str(), &end);
    if (*end != '\0' || !(value >= 0 && value <= most))
      return Error{ErrorKind::kUsage, "'" + said + "' is no number from 0 to " + std::to_string(most), option,
                   "kilograms of what is held at the arm's end"};
    return std::optional<double>(value);
  }

 private:
  std::map<std::string, std::string> values_;
  std::vector<std::string> all_;
};

constexpr double kMostHeld_kg = 1;

}  // namespace

void add_device_options(CLI::App& verb, DeviceOptions& options) {
  verb.add_option("--library", options.libraries,
                  "NAME=FILE: the file of a device's maker's library; default: looked for in the system's "
                  "folders (docs/reference/devices.md)")
      ->allow_extra_args(false);
  verb.add_option("--held-mass", options.held_masses,
                  "NAME=KG: what is held at a device's end where that is not the maker's own, carried by the "
                  "device")
      ->allow_extra_args(false);
  verb.add_option("--device-config", options.configs,
                  "touch=NAME: the name by which the maker's setup knows the device; as often as there are; "
                  "default: the default one")
      ->allow_extra_args(false);
}

Result<DeviceRegistry> known_devices(const DeviceOptions& options) {
  const std::vector<std::string> by_library{"force-dimension", "touch"};
  const auto libraries = Named::parse("--library", options.libraries, by_library);
  if (!libraries) return libraries.error();
  const auto masses = Named::parse("--held-mass", options.held_masses, by_library);
  if (!masses) return masses.error();

  ForceDimensionSettings force_dimension;
  force_dimension.library.file = libraries->text("force-dimension");
  const auto held_kg = masses->number("--held-mass", "force-dimension", kMostHeld_kg);
  if (!held_kg) return held_kg.error();
  force_dimension.held_mass_kg = *held_kg;

  OpenHapticsSettings openhaptics;
  openhaptics.library.file = libraries->text("touch");
  const auto held_by_touch_kg = masses->number("--held-mass", "touch", kMostHeld_kg);
  if (!held_by_touch_kg) return held_by_touch_kg.error();
  openhaptics.held_mass_kg = *held_by_touch_kg;
  const auto configs = Named::parse("--device-config", options.configs, {"touch"}, true);
  if (!configs) return configs.error();
  openhaptics.names = configs->all();
  if (openhaptics.names.size() > static_cast<std::size_t>(kMaxDevices))
    return Error{ErrorKind::kUsage, std::to_string(openhaptics.names.size()) + " devices", "--device-config",
                 "a session has " + std::to_string(kMaxDevices) + " at most"};

  DeviceRegistry registry;
  registry.add(haply_maker());
  registry.add(force_dimension_maker(force_dimension));
  registry.add(openhaptics_maker(openhaptics));
  registry.add(spacemouse_maker());
  return registry;
}

}  // namespace palpate::app
