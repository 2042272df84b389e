#include <algorithm>

#include "verification/accuracy.h"
#include "verification/machine.h"

namespace palpate {
namespace {

struct Suite {
  const char* name;
  const char* line;
  Result<std::vector<Figure>> (*run)(const Progress&);
};

constexpr Suite kSuites[] = {
    {"accuracy", "direction and magnitude of the force against known surfaces", run_accuracy},
};

}  // namespace

bool SuiteReport::ok() const {
  return std::all_of(figures.begin(), figures.end(), [](const Figure& figure) { return figure.ok(); });
}

std::vector<std::pair<std::string, std::string>> verification_suites() {
  std::vector<std::pair<std::string, std::string>> suites;
  for (const Suite& suite : kSuites) suites.emplace_back(suite.name, suite.line);
  return suites;
}

Result<SuiteReport> run_suite(const std::string& name, const Progress& progress) {
  std::string names;
  for (const Suite& suite : kSuites) {
    if (suite.name == name) {
      auto figures = suite.run(progress);
      if (!figures) return figures.error();
      return SuiteReport{name, machine_description(), build_description(), *std::move(figures)};
    }
    names += names.empty() ? suite.name : std::string(", ") + suite.name;
  }
  return Error{ErrorKind::kUsage, "there is no verification suite '" + name + "'", "", "suites: " + names};
}

}  // namespace palpate
