#include "palpate/doctor/doctor.h"

#include <cstdio>
#include <iostream>
#include <memory>

#include "apps/command/text.h"
#include "grip_records.h"
#include "known_devices.h"
#include "palpate/json/json.h"
#include "verb.h"

namespace palpate::app {
namespace {

struct DoctorArguments {
  DoctorSettings settings;
  DeviceOptions about_devices;
  bool json = false;
  std::string hold;
  double hold_rate_hz = 1000;
};

Json report_json(const DoctorReport& report) {
  auto lines = Json::array();
  for (const DoctorLine& line : report.lines)
    lines.push_back({{"topic", line.topic},
                     {"what", line.what},
                     {"finding", name_of(line.finding)},
                     {"found", line.found},
                     {"remedy", line.remedy}});
  const TimerFigures& timer = report.timer;
  return {{"ready", !report.missing()},
          {"lines", lines},
          {"timer",
           {{"seconds", timer.seconds},
            {"rate_hz", timer.rate_hz},
            {"lateness_p50_us", timer.p50_us},
            {"lateness_p99_us", timer.p99_us},
            {"lateness_max_us", timer.max_us},
            {"on_time", timer.on_time}}}};
}

// prints a remedy with its lines aligned
void print_cure(const std::string& remedy) {
  std::size_t from = 0;
  const char* head = "what to do: ";
  while (from <= remedy.size()) {
    const std::size_t to = std::min(remedy.find('\n', from), remedy.size());
    std::printf("           %s%s\n", head, remedy.substr(from, to - from).c_str());
    head = "            ";
    from = to + 1;
  }
}

void print_report(const DoctorReport& report) {
  std::string topic;
  for (const DoctorLine& line : report.lines) {
    if (line.topic != topic) std::printf("%s%s\n", topic.empty() ? "" : "\n", line.topic.c_str());
    topic = line.topic;
    const char* word = line.finding == Finding::kMissing  ? "MISSING"
                       : line.finding == Finding::kAdvice ? "advice"
                                                          : "fine";
    std::printf("  %-7s  %s: %s\n", word, line.what.c_str(), line.found.c_str());
    if (line.finding != Finding::kFine) print_cure(line.remedy);
  }
  std::size_t missing = 0, advice = 0;
  for (const DoctorLine& line : report.lines) {
    missing += line.finding == Finding::kMissing;
    advice += line.finding == Finding::kAdvice;
  }
  std::printf("\n");
  if (missing > 0)
    std::printf(
        "%zu missing: force-feedback devices are not ready on this computer. Everything else works.\n",
        missing);
  else
    std::printf("Nothing is missing%s.\n", advice > 0 ? "; lines marked as advice could be improved" : "");
}

}  // namespace

void add_doctor(CLI::App& app, Run& run) {
  auto options = std::make_shared<DoctorArguments>();
  CLI::App* verb = app.add_subcommand("doctor", "Check this computer for use with a force-feedback device");
  verb->add_flag("--json", options->json, "Print JSON, to attach to a bug report");
  verb->add_option("--seconds", options->settings.timer_s,
                   "Duration of the clock measurement in seconds; default: 5")
      ->check(number_between(0.1, 600));
  verb->add_option("--device", options->settings.devices,
                   "Required device (palpate devices, or plugin=FILE); may be repeated; default: any")
      ->allow_extra_args(false);
  add_device_options(*verb, options->about_devices);
  verb->add_option("--hold", options->hold,
                   "Measure the stiffness that a hand holds stably with a device or simulated; the device "
                   "gives up to 1 N");
  verb->add_option("--rate", options->hold_rate_hz, "Servo rate of --hold in Hz; default: 1000")
      ->check(number_between(250, 10000));
  verb->footer(
      "Examples:\n"
      "  palpate doctor\n"
      "  palpate doctor --device haply --json\n"
      "  palpate doctor --hold touch\n\n"
      "Only --hold applies force, after confirmation; otherwise nothing moves and nothing is changed.\n"
      "--hold measures the delay and the stiffness that a hand holds stably, and explore uses the result. "
      "Every "
      "line\n"
      "that reports a problem says how to solve it. The exit code is 1 if a requirement is missing: "
      "permissions\n"
      "of the account, an accurate clock, or what a device needs. Without --device, any one device is "
      "enough.\n"
      "More in docs/reference/doctor.md; requirements of each device in docs/reference/devices.md.");
  verb->callback([options, &run] {
    run = [options](Console& console) -> int {
      // the weight that the device compensates would add to the force of the trial
      if (!options->hold.empty() && !options->about_devices.held_masses.empty())
        return console.fail({ErrorKind::kUsage, "carries a weight, and --hold gives at most 1 N",
                             "--held-mass", "leave it out: hold the device without a tool"});
      const auto known = known_devices(options->about_devices, nullptr, options->settings.devices);
      if (!known) return console.fail(known.error());
      if (!options->hold.empty())
        return record_grip_trial(*known, options->hold, options->hold_rate_hz, options->json, console);
      const auto report = examine(*known, options->settings, console.progress());
      if (!report) return console.fail(report.error());
      if (options->json)
        std::cout << report_json(*report).dump(2) << '\n';
      else
        print_report(*report);
      return report->missing() ? kExitBadInput : kExitOk;
    };
  });
}

}  // namespace palpate::app
