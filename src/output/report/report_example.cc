#include <cstdio>
#include <string_view>

#include "palpate/report/report.h"
#include "report/test_example_run.h"

namespace example = palpate::report::example;

/// Writes the report of an example run: report_example FILE.html [real|milled|planned]
int main(int argc, char** argv) {
  const std::string_view kind = argc == 3 ? argv[2] : "";
  if (argc < 2 || argc > 3 || (argc == 3 && kind != "real" && kind != "milled" && kind != "planned")) {
    std::fprintf(stderr, "usage: report_example FILE.html [real|milled|planned]\n");
    return 2;
  }
  palpate::Model model = example::model();
  if (kind == "milled") model = example::with_burr(model);
  const palpate::Recording recording = kind == "real"     ? example::real_recording(model)
                                       : kind == "milled" ? example::milled_recording(model)
                                                          : example::recording(model);
  const auto write = [&]() -> palpate::Result<void> {
    if (kind != "planned") return palpate::write_report(argv[1], recording, model);
    const palpate::PlanInScene plan = example::plan(model);
    const auto distances = palpate::structure_distances(model);
    if (!distances) return distances.error();
    const auto made = palpate::compare_recording(plan, model, *distances, recording);
    if (!made) return made.error();
    const palpate::RehearsedPlan rehearsed{plan, *made};
    return palpate::write_report(argv[1], recording, model, {}, {.rehearsed = &rehearsed});
  };
  const auto written = write();
  if (!written.ok()) std::fprintf(stderr, "%s\n", written.error().message().c_str());
  return written.ok() ? 0 : 1;
}
