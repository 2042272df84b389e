#include <cstdio>
#include <iostream>
#include <memory>

#include "apps/command/text.h"
#include "known_devices.h"
#include "palpate/json/json.h"
#include "palpate/session/explore.h"
#include "verb.h"

namespace palpate::app {
namespace {

// state of a driver; empty if its checks pass and a device is connected
const char* state_of(const DeviceReport& report) {
  for (const DeviceCheck& check : report.checks)
    if (!check.passed) return "not ready: palpate doctor shows what is missing";
  return report.connected.empty() ? "nothing is connected" : "";
}

Json own_json(const char* name, const char* what) {
  return {{"name", name}, {"what", what}, {"simulated", true}, {"ready", true}, {"connected", Json::array()}};
}

struct OwnDevice {
  const char *name, *what;
};
constexpr OwnDevice kOwn[] = {
    {kSimulatedHand, "a simulated hand and device that follow a script; always available"},
    {kPointer, "a viewer's mouse, pen or finger, through the page; always available"},
    {kRos2Hand, "a hand that a node of ROS 2 moves (explore --ros2); always available"}};

int print_json(const DeviceRegistry& known) {
  auto rows = Json::array();
  for (const OwnDevice& own : kOwn) rows.push_back(own_json(own.name, own.what));
  for (const DeviceVendor& vendor : known.all()) {
    const DeviceReport report = vendor.detect();
    Json row = {{"name", vendor.name},
                {"what", vendor.what},
                {"simulated", false},
                {"ready", *state_of(report) == '\0'},
                {"connected", Json::array()}};
    for (const ConnectedDevice& device : report.connected)
      row["connected"].push_back({{"id", device.id}, {"state", device.state}});
    rows.push_back(std::move(row));
  }
  std::cout << Json{{"devices", rows}}.dump(2) << '\n';
  return kExitOk;
}

int print_text(const DeviceRegistry& known) {
  const auto row = [](const std::string& name, const std::string& what) {
    std::printf("%s %s\n", pad_or_truncate(name, 16).c_str(), what.c_str());
  };
  for (const OwnDevice& own : kOwn) row(own.name, own.what);
  for (const DeviceVendor& vendor : known.all()) {
    row(vendor.name, vendor.what);
    const DeviceReport report = vendor.detect();
    if (const char* state = state_of(report); *state != '\0') row("", state);
    for (const ConnectedDevice& device : report.connected) row("", device.id + ": " + device.state);
  }
  std::printf(
      "\n"
      "to use one: palpate explore SCENE --device NAME\n");
  return kExitOk;
}

}  // namespace

void add_devices(CLI::App& app, Run& run) {
  auto json = std::make_shared<bool>(false);
  auto about = std::make_shared<DeviceOptions>();
  CLI::App* verb = app.add_subcommand("devices", "List the supported devices and whether each is connected");
  verb->add_flag("--json", *json, "Print JSON instead of text");
  add_device_options(*verb, *about);
  verb->footer(
      "Example:\n"
      "  palpate devices\n\n"
      "No device moves or applies force. palpate doctor shows what a device lacks on this machine and how\n"
      "to provide it; docs/reference/devices.md lists the requirements of each device.");
  verb->callback([json, about, &run] {
    run = [json, about](Console& console) {
      const auto known = known_devices(*about);
      if (!known) return console.fail(known.error());
      return *json ? print_json(*known) : print_text(*known);
    };
  });
}

}  // namespace palpate::app
