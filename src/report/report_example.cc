#include <cstdio>

#include "palpate/report.h"
#include "report/example_run.h"

/// Writes the report of the example run: report_example FILE.html
int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: report_example FILE.html\n");
    return 2;
  }
  const palpate::Model model = palpate::report::example::model();
  const auto written = palpate::write_report(argv[1], palpate::report::example::recording(model), model);
  if (!written.ok()) std::fprintf(stderr, "%s\n", written.error().message().c_str());
  return written.ok() ? 0 : 1;
}
