#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <iterator>

#include "openhaptics/hd_calls.h"
#include "palpate/base/printable.h"
#include "palpate/openhaptics/openhaptics_driver.h"

namespace palpate {
namespace {

// the library also finds its devices by files in a folder
DeviceCheck setup_check() {
  const char* home = std::getenv("GTDD_HOME");
  const std::filesystem::path folder = home && *home ? home : "/usr/share/3DSystems";
  std::error_code ignored;
  const bool there = std::filesystem::is_directory(folder, ignored);
  return {"the vendor's configuration", there,
          there ? printable_name(folder.string())
                : "there is no folder " + printable_name(folder.string()) +
                      (home && *home ? "" : ", and GTDD_HOME is not set to one"),
          there ? ""
                : "run the vendor's setup program (Touch_Setup), and set GTDD_HOME to the folder of its "
                  "configuration"};
}

// a Touch is connected as a USB serial port
std::vector<DeviceCheck> port_checks() {
  std::vector<DeviceCheck> checks;
  for (int n = 0; n < 4; ++n) {
    const std::string port = "/dev/ttyACM" + std::to_string(n);
    if (::access(port.c_str(), F_OK) != 0) continue;
    const bool may = ::access(port.c_str(), R_OK | W_OK) == 0;
    checks.push_back({"serial port", may, may ? port : "this account may not use " + port,
                      may ? ""
                          : "an administrator enters sudo usermod -aG dialout NAME (the account), then log "
                            "out and in again"});
  }
  return checks;
}

DeviceReport detect_hd(const OpenHapticsSettings& settings) {
  DeviceReport report;
  const auto file = find_vendor_library(settings.library, "OpenHaptics", hd::kMissingLibraryRemedy);
  const auto library = file ? hd::load(*file) : Result<hd::Library>(file.error());
  if (!library) {
    report.checks.push_back({"OpenHaptics' library", false, library.error().what, library.error().remedy});
    return report;
  }
  report.checks.push_back({"OpenHaptics' library", true, file->string(), ""});
  bool all = true;
  for (const std::string& name : settings.names.empty() ? std::vector<std::string>{""} : settings.names) {
    unsigned error = hd::kNoError;
    const hd::Handle handle = hd::init(*library, name, error);
    if (handle == hd::kBadHandle) {
      const Error why = hd::init_error(*library, error, name);
      report.checks.push_back({name.empty() ? "device" : name, false, why.what, why.remedy});
      all = false;
      continue;
    }
    library->hdMakeCurrentDevice(handle);
    const std::string model = hd::text_of(*library, hd::kModelType),
                      serial = hd::text_of(*library, hd::kSerialNumber);
    const bool calibrated = library->hdCheckCalibration() == hd::kCalibrated;
    library->hdDisableDevice(handle);
    hd::drain(*library);
    const std::string id = model + " no. " + serial;
    const std::string state = calibrated ? "ready" : "not calibrated yet: the session will show how";
    report.connected.push_back({id, state});
    report.checks.push_back({id, true, state, ""});
  }
  if (!all) {
    report.checks.push_back(setup_check());
    std::ranges::copy(port_checks(), std::back_inserter(report.checks));
  }
  return report;
}

}  // namespace

DeviceVendor openhaptics_vendor(const OpenHapticsSettings& settings) {
  return {"touch", "3D Systems Touch, Touch X and Phantom Premium, through OpenHaptics",
          [settings] { return std::make_unique<OpenHapticsDriver>(settings); },
          [settings] { return detect_hd(settings); }};
}

}  // namespace palpate
