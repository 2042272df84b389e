#include <cstdio>
#include <string_view>

#include "palpate/report/report.h"
#include "report/example_run.h"

namespace example = palpate::report::example;

/// Writes the report of an example run: report_example FILE.html [real|milled]
int main(int argc, char** argv) {
  const std::string_view kind = argc == 3 ? argv[2] : "";
  if (argc < 2 || argc > 3 || (argc == 3 && kind != "real" && kind != "milled")) {
    std::fprintf(stderr, "usage: report_example FILE.html [real|milled]\n");
    return 2;
  }
  palpate::Model model = example::model();
  if (kind == "milled") model = example::with_burr(model);
  const palpate::Recording recording = kind == "real"     ? example::real_recording(model)
                                       : kind == "milled" ? example::milled_recording(model)
                                                          : example::recording(model);
  const auto written = palpate::write_report(argv[1], recording, model);
  if (!written.ok()) std::fprintf(stderr, "%s\n", written.error().message().c_str());
  return written.ok() ? 0 : 1;
}
