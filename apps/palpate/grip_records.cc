#include "grip_records.h"

#include <termios.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <iostream>
#include <system_error>
#include <thread>

#include "apps/command/keys.h"
#include "palpate/base/file.h"
#include "palpate/catalog/catalog.h"
#include "palpate/device/simulated_device.h"
#include "palpate/json/json.h"
#include "palpate/session/explore.h"
#include "palpate/supervisor/supervisor.h"

namespace palpate::app {
namespace {

constexpr std::size_t kMaxFile_bytes = 1 << 20;

// simulated device in a light grip, with the delay of a typical USB device
std::unique_ptr<DeviceDriver> simulated() {
  constexpr double kDelay_s = 0.002;
  SimulatedDevice device(*find_plant_device("premium-1.5"), *find_plant_hand("light-grip"), kDelay_s);
  device.reset(Point<Device>(0, 0, 0));
  return std::make_unique<SimulatedDriver>(device);
}

Error not_armed(const std::string& name) {
  return {ErrorKind::kUsage, "the device was not armed", name,
          "run the command in a terminal, hold the tip and press a"};
}

/// Asks for confirmation that somebody holds the device. Errors: kUsage without a terminal, or for any other
/// key; kInterrupted.
Result<void> arm(const std::string& name, Console& console) {
  Keys keys(console.streams().in);
  // without a visible prompt there is no informed consent
  if (!keys.active() || !::isatty(console.streams().err)) return not_armed(name);
  std::fprintf(
      stderr,
      "Hold the tip lightly, in free air, at one place, and keep holding it. It gives up to 1 N for\n"
      "up to 15 s, and may buzz at the end. Releasing the tip does not stop it: press Ctrl-C to stop.\n"
      "Press a to arm the device; any other key cancels.\n");
  // discards keys typed before the prompt
  ::tcflush(console.streams().in, TCIFLUSH);
  const Progress progress = console.progress();
  while (!progress.stopped()) {
    if (const auto key = keys.next()) return *key == 'a' ? Result<void>() : not_armed(name);
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  return Error{ErrorKind::kInterrupted, "stopped", "", ""};
}

Result<void> store(const GripTrialFigures& figures) {
  auto hands = stored_grip_figures();
  if (!hands) return hands.error();
  (*hands)[figures.device] = figures;
  const std::string text = grip_figures_text(*hands);
  // a stored entry that cannot be parsed would make every session fail
  if (const auto again = parse_grip_figures(text, grip_figures_file().string()); !again)
    return Error{ErrorKind::kUnavailable, "the measured values are implausible for a device", figures.device,
                 "try again; nothing was stored"};
  std::error_code failed;
  std::filesystem::create_directories(grip_figures_file().parent_path(), failed);
  return write_file(grip_figures_file(), text);
}

void print_json(const GripTrialFigures& figures) {
  Json json{{"device", figures.device},   {"rate_hz", figures.rate_hz},
            {"delay_s", figures.delay_s}, {"held_N_per_mm", figures.stable_N_per_mm},
            {"swings_N_per_mm", nullptr}, {"advised_N_per_mm", figures.recommended_N_per_mm}};
  if (figures.oscillating_N_per_mm) json["swings_N_per_mm"] = *figures.oscillating_N_per_mm;
  std::cout << json.dump(2) << '\n';
}

void print_text(const GripTrialFigures& figures) {
  std::printf("%s, %.0f updates a second\n", figures.device.c_str(), figures.rate_hz);
  std::printf("from a command to its force   %.2f ms\n", 1e3 * figures.delay_s);
  std::printf("stable at                     %.3g N/mm\n", figures.stable_N_per_mm);
  if (figures.oscillating_N_per_mm)
    std::printf("oscillates at                 %.3g N/mm\n", *figures.oscillating_N_per_mm);
  else
    std::printf("oscillates at                 no stiffness tried\n");
  std::printf("explore limits its stiffness to %.3g N/mm, and to the vendor's limit\n",
              figures.recommended_N_per_mm);
}

}  // namespace

std::filesystem::path grip_figures_file() {
  return user_data_folder() / "held-hands.txt";
}

Result<GripFiguresByDevice> stored_grip_figures() {
  const std::filesystem::path file = grip_figures_file();
  std::error_code ignored;
  if (!std::filesystem::exists(file, ignored)) return GripFiguresByDevice{};
  const auto text = read_file(file, kMaxFile_bytes);
  if (!text) return text.error();
  return parse_grip_figures(*text, file.string());
}

DeviceRegistry with_grip_figures(const DeviceRegistry& known, const GripFiguresByDevice& figures,
                                 double rate_hz) {
  DeviceRegistry all;
  for (const DeviceVendor& vendor : known.all()) {
    DeviceVendor with_figures = vendor;
    with_figures.make = [make = vendor.make, figures, rate_hz] {
      return palpate::with_grip_figures(make(), figures, rate_hz);
    };
    all.add(std::move(with_figures));
  }
  return all;
}

int record_grip_trial(const DeviceRegistry& known, const std::string& name, double rate_hz, bool json,
                      Console& console) {
  const DeviceVendor* vendor = known.find(name);
  const bool is_simulated = name == kSimulatedHand;
  if (!is_simulated && !vendor) return console.fail(check_devices({name}, known).error());
  // an unreadable file would be overwritten
  if (const auto stored = stored_grip_figures(); !stored) return console.fail(stored.error());
  std::unique_ptr<DeviceDriver> driver = is_simulated ? simulated() : vendor->make();
  if (auto opened = driver->open(false); !opened) return console.fail(opened.error());
  if (driver->devices()[0].degrees_of_freedom_out == 0)
    return console.fail(
        {ErrorKind::kUsage, "the device gives no force", name, "choose a force-feedback device"});
  if (!is_simulated)
    if (const auto armed = arm(name, console); !armed) return console.fail(armed.error());

  SupervisorSettings watching;
  watching.command = {"/proc/self/exe", "supervise"};
  watching.kill_frozen = true;
  const auto supervisor = Supervisor::start(watching);
  if (!supervisor) return console.fail(supervisor.error());
  GripTrialSettings settings;
  settings.rate_hz = rate_hz;
  settings.heartbeat = &(*supervisor)->heartbeat();
  const auto figures = run_grip_trial(*driver, settings, console.progress());
  if (!figures) return console.fail(figures.error());
  if (auto written = store(*figures); !written) return console.fail(written.error());
  json ? print_json(*figures) : print_text(*figures);
  console.note("stored in " + grip_figures_file().string());
  return kExitOk;
}

}  // namespace palpate::app
