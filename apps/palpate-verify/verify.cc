#include <cstdio>
#include <memory>
#include <optional>

#include "apps/command/options.h"
#include "palpate/base/output.h"
#include "palpate/cache/cache.h"
#include "palpate/verification/verification.h"
#include "verify.h"

namespace palpate::app {
namespace {

constexpr const char* kVerifyExamples =
    "Examples:\n"
    "  palpate verify --list                            list the suites\n"
    "  palpate verify contact                           terraces, seams, layers, thin sheets\n"
    "  palpate verify accuracy                          table of figures and limits\n"
    "  palpate verify accuracy --json accuracy.json     also as JSON\n"
    "  palpate verify latency                           timing of the servo, about a minute\n"
    "  palpate verify latency --rate 4000 --spin 80     one rate, busy-waiting before every tick\n"
    "  palpate verify stability                         stability limits and buzz\n"
    "  palpate verify removal                           volume that a burr removes from bone\n"
    "  palpate verify tissue                            soft tissue against analytic cases\n"
    "  palpate verify outside CURVES.csv                measured indentation curves against presets\n\n"
    "Exit code 3: a figure exceeds its limit. See docs/reference/verify.md.";

struct VerifyOptions {
  std::string suite, json;
  bool list = false;
  SuiteOptions suite_options;
};

void list_suites() {
  for (const auto& [name, line] : verification_suites())
    std::printf("%-12s %s\n", name.c_str(), line.c_str());
}

int verify(const VerifyOptions& options, Console& console) {
  if (options.list) {
    list_suites();
    return kExitOk;
  }
  if (options.suite.empty()) {
    return console.fail({ErrorKind::kUsage, "no suite given", "", "palpate verify --list shows the suites"});
  }
  std::optional<OutputClaim> claimed;
  if (!options.json.empty()) {
    auto used = claim_output(options.json);
    if (!used) return console.fail(used.error());
    claimed = *std::move(used);
  }
  // the small volumes of the suite are not worth caching: nobody opens these scenes again
  set_cache({});
  const auto report = run_suite(options.suite, options.suite_options, console.progress(), console.warn());
  if (!report) return console.fail(report.error());
  std::fputs(to_table(*report).c_str(), stdout);
  if (!options.json.empty()) {
    if (const auto written = write_json(options.json, *report); !written)
      return console.fail(written.error());
    console.note("figures written to " + options.json);
  }
  return report->ok() ? kExitOk : kExitLimit;
}

}  // namespace

void add_verify(CLI::App& app, Run& run) {
  auto options = std::make_shared<VerifyOptions>();
  CLI::App* verb = app.add_subcommand(
      "verify", "Measure this build on this machine and compare the figures with their limits");
  verb->add_option("suite", options->suite, "Suite to run")->type_name("SUITE");
  verb->add_option("curves", options->suite_options.curves, "outside: measured indentation curves (CSV)")
      ->type_name("CURVES.csv");
  verb->add_option("-o,--json", options->json, "Also write the figures as JSON")->type_name("FILE");
  verb->add_flag("-l,--list", options->list, "List the suites");
  SuiteOptions& of_suite = options->suite_options;
  verb->add_option("--seconds", of_suite.seconds, "latency: duration of each loop at each rate; default: 3")
      ->check(number_between(0.05, 3600));
  verb->add_option("--spin", of_suite.spin_us, "latency: busy-wait this long before every tick; default: 0")
      ->check(number_between(0, 1000));
  verb->add_option("--rate", of_suite.rate_hz, "latency: servo rate in Hz; default: 1, 2, 4, 8 and 10 kHz")
      ->check(number_between(250, 10000));
  verb->add_option("--scene", of_suite.scene,
                   "latency: a data set (palpate data list) or a scene file; default knee-phantom");
  verb->footer(kVerifyExamples);
  verb->callback(
      [options, &run] { run = [options](Console& console) { return verify(*options, console); }; });
}

}  // namespace palpate::app
