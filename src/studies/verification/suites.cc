#include <algorithm>

#include "verification/accuracy.h"
#include "verification/label_contact.h"
#include "verification/latency.h"
#include "verification/machine.h"
#include "verification/outside.h"
#include "verification/removal.h"
#include "verification/stability.h"
#include "verification/tissue.h"

namespace palpate {
namespace {

struct Suite {
  const char* name;
  const char* line;
  // produces notes and figures
  Result<SuiteReport> (*run)(const SuiteOptions&, const Progress&, const Warn&);
};

Result<SuiteReport> accuracy(const SuiteOptions&, const Progress& progress, const Warn&) {
  auto figures = run_accuracy(progress);
  if (!figures) return figures.error();
  SuiteReport report;
  report.figures = *std::move(figures);
  return report;
}

Result<SuiteReport> stability(const SuiteOptions&, const Progress& progress, const Warn&) {
  return run_stability(progress);
}

Result<SuiteReport> contact(const SuiteOptions&, const Progress& progress, const Warn&) {
  return run_label_contact(progress);
}

Result<SuiteReport> removal(const SuiteOptions&, const Progress& progress, const Warn&) {
  return run_removal(progress);
}

Result<SuiteReport> tissue(const SuiteOptions&, const Progress& progress, const Warn&) {
  return run_tissue(progress);
}

constexpr Suite kSuites[] = {
    {"contact", "what the default method feels of label maps: terraces, seams, layers, thin sheets", contact},
    {"accuracy", "direction, magnitude and choppiness of every method against known surfaces", accuracy},
    {"latency", "timing of the servo compared with a bare loop, and its maximum rate", run_latency},
    {"stability", "what simulated hands and devices hold: stiffness, buzz, energy, friction, drift",
     stability},
    {"removal", "what a burr takes out of bone: volume, work and steps at any rate and on any grid", removal},
    {"outside", "your measured indentation curves against presets and fits: verify outside CURVES.csv",
     run_outside},
    {"tissue", "deformable soft tissue compared with analytic solutions, and the cost of its frames", tissue},
};

const Suite* find_suite(const std::string& name) {
  const auto* suite = std::find_if(std::begin(kSuites), std::end(kSuites),
                                   [&](const Suite& one) { return name == one.name; });
  return suite != std::end(kSuites) ? suite : nullptr;
}

Error unknown_suite(const std::string& name) {
  std::string names;
  for (const Suite& suite : kSuites) names += (names.empty() ? "" : ", ") + std::string(suite.name);
  return {ErrorKind::kUsage, "there is no verification suite '" + name + "'", "", "suites: " + names};
}

// name of an option that was given to a suite without options, or null
const char* supplied_option(const SuiteOptions& options) {
  if (options.seconds) return "seconds";
  if (options.spin_us) return "spin";
  if (options.rate_hz) return "rate";
  if (options.scene) return "scene";
  return nullptr;
}

}  // namespace

bool SuiteReport::ok() const {
  return std::all_of(figures.begin(), figures.end(), [](const Figure& figure) { return figure.ok(); });
}

std::vector<std::pair<std::string, std::string>> verification_suites() {
  std::vector<std::pair<std::string, std::string>> suites;
  for (const Suite& suite : kSuites) suites.emplace_back(suite.name, suite.line);
  return suites;
}

Result<SuiteReport> run_suite(const std::string& name, const SuiteOptions& options, const Progress& progress,
                              const Warn& warn) {
  const Suite* suite = find_suite(name);
  if (suite == nullptr) return unknown_suite(name);
  const char* option = supplied_option(options);
  if (options.curves && name != "outside")
    return Error{ErrorKind::kUsage, "the suite '" + name + "' takes no file", options.curves->string(),
                 "leave it out; palpate verify --help says whose it is"};
  if (option != nullptr && name != "latency")
    return Error{ErrorKind::kUsage, "the suite '" + name + "' takes no --" + option, "",
                 "leave it out; palpate verify --help says whose it is"};
  auto report = suite->run(options, progress, warn);
  if (!report) return report.error();
  report->suite = name;
  report->machine = machine_description();
  report->build = build_description();
  report->date = today();
  return report;
}

}  // namespace palpate
