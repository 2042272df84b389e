#include <memory>
#include <variant>

#include "haply/service_search.h"
#include "palpate/haply/haply_driver.h"

namespace palpate {
namespace {

using haply::Failure;
using haply::Found;
using haply::Inverse3;
using haply::NotFound;

std::string state_in_words(const haply::Status& status) {
  if (status.in_use.value_or(false)) return "in use by another program";
  const Failure failure = haply::failure_of(status);
  return failure == Failure::kNone ? "ready" : haply::words_for(failure).what;
}

DeviceReport detect(const HaplySettings& settings) {
  DeviceReport report;
  const std::string endpoint = "Inverse Service at " + settings.host + ":" + std::to_string(settings.port);
  auto result = haply::connect_to_service(settings);
  if (const auto* none = std::get_if<NotFound>(&result)) {
    report.checks.push_back({endpoint, false, none->error.what, none->error.remedy});
    return report;
  }
  const Found* const found = std::get_if<Found>(&result);
  report.checks.push_back(
      {endpoint, true,
       "version " + std::to_string(found->version.major) + "." + std::to_string(found->version.minor), ""});
  if (found->inventory.devices.empty())
    report.checks.push_back({"Inverse3", false, "the service detects none",
                             "connect it by USB, power it, and check that its light is on"});
  for (const Inverse3& device : found->inventory.devices) {
    const Failure failure = haply::failure_of(device.status);
    const bool in_use = device.status.in_use.value_or(false);
    report.connected.push_back({device.id, state_in_words(device.status)});
    report.checks.push_back({haply::name_of(device), failure == Failure::kNone && !in_use,
                             state_in_words(device.status),
                             in_use ? "close the program that uses it" : haply::words_for(failure).remedy});
  }
  return report;
}

}  // namespace

DeviceVendor haply_vendor(const HaplySettings& settings) {
  return {"haply", "Haply Inverse3, through the Inverse Service (3.0, 3.1, 3.5 on)",
          [settings] { return std::make_unique<HaplyDriver>(settings); },
          [settings] { return detect(settings); }};
}

}  // namespace palpate
