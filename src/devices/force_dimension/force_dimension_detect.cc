#include <algorithm>
#include <array>
#include <iterator>

#include "force_dimension/dhd_calls.h"
#include "force_dimension/force_dimension_failures.h"
#include "force_dimension/models.h"
#include "palpate/device/usb.h"
#include "palpate/force_dimension/force_dimension_driver.h"

namespace palpate {
namespace {

constexpr std::uint16_t kForceDimensionUsb = 0x1451, kFtdiUsb = 0x0403, kFalconUsb = 0xcb48;

DeviceReport detect_dhd(const ForceDimensionSettings& settings) {
  DeviceReport report;
  std::vector<UsbDevice> plugged = usb_devices(kForceDimensionUsb);
  std::ranges::copy(usb_devices(kFtdiUsb, kFalconUsb), std::back_inserter(plugged));
  const auto file =
      find_vendor_library(settings.library, "Force Dimension's library", dhd::kMissingLibraryRemedy);
  const auto library = file ? dhd::load(*file) : Result<dhd::Library>(file.error());
  if (!library) {
    report.checks.push_back(
        {"Force Dimension's library", false, library.error().what, library.error().remedy});
    if (!plugged.empty())
      std::ranges::copy(usb_checks(plugged, "a device"), std::back_inserter(report.checks));
    return report;
  }
  std::array<int, 4> version{};
  library->dhdGetSDKVersion(&version[0], &version[1], &version[2], &version[3]);
  report.checks.push_back({"Force Dimension's library", true,
                           file->string() + ", version " + std::to_string(version[0]) + "." +
                               std::to_string(version[1]) + "." + std::to_string(version[2]),
                           ""});
  const int count = library->dhdGetDeviceCount();
  if (count <= 0) {
    std::ranges::copy(usb_checks(plugged, "a Force Dimension device or a Falcon"),
                      std::back_inserter(report.checks));
    if (!plugged.empty() && std::ranges::all_of(plugged, &UsbDevice::may_use))
      report.checks.push_back({"device", false, "the system detects one, but the library does not",
                               "switch it off and on again; close programs that use it"});
    return report;
  }
  for (int index = 0; index < std::min(count, kMaxDevices); ++index) {
    const std::string device_name = "device " + std::to_string(index + 1);
    const int opened = dhd::open_device(*library, index);
    if (opened < 0) {
      const Error error =
          dhd::library_error(*library, "cannot be opened", device_name, "close the program that uses it");
      report.connected.push_back({device_name, error.what});
      report.checks.push_back({device_name, false, error.what, error.remedy});
      continue;
    }
    const auto id = static_cast<char>(opened);
    const dhd::Identity identity = dhd::identity_of(*library, id);
    const bool ready = dhd::is_initialised(*library, id);
    const dhd::Words words =
        dhd::words_for(dhd::model_of(identity.type).by_hand ? dhd::Failure::kNeedsManualInitialisation
                                                            : dhd::Failure::kNotInitialised);
    const std::string state = ready ? "ready" : words.what;
    dhd::close_device(*library, id);
    report.connected.push_back({dhd::name_of(identity), state});
    report.checks.push_back({dhd::name_of(identity), ready, state, ready ? "" : words.remedy});
  }
  return report;
}

}  // namespace

DeviceVendor force_dimension_vendor(const ForceDimensionSettings& settings) {
  return {"force-dimension",
          "Force Dimension omega, sigma and delta, and Novint Falcon, through the vendor's library",
          [settings] { return std::make_unique<ForceDimensionDriver>(settings); },
          [settings] { return detect_dhd(settings); }};
}

}  // namespace palpate
