#include <cstdio>
#include <string_view>

#include "palpate/report.h"
#include "report/example_run.h"

/// Writes the report of the example run: report_example FILE.html [real]
int main(int argc, char** argv) {
  const bool real = argc == 3 && std::string_view(argv[2]) == "real";
  if (argc != 2 && !real) {
    std::fprintf(stderr, "usage: report_example FILE.html [real]\n");
    return 2;
  }
  namespace example = palpate::report::example;
  const palpate::Model model = example::model();
  const auto written = palpate::write_report(
      argv[1], real ? example::real_recording(model) : example::recording(model), model);
  if (!written.ok()) std::fprintf(stderr, "%s\n", written.error().message().c_str());
  return written.ok() ? 0 : 1;
}
