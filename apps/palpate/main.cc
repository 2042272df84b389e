#include <csignal>
#include <cstdio>
#include <exception>
#include <string>

#include "palpate_version.h"
#include "verb.h"

namespace palpate::app {
namespace {

constexpr const char* kExamples =
    "Examples:\n"
    "  palpate info knee.seg.nrrd                       what is in a file\n"
    "  palpate simulate knee-phantom --report run.html  palpate a generated knee\n"
    "  palpate scene new scan.nii.gz labels.nii.gz -o scene.toml\n"
    "  palpate simulate scene.toml -o run.h5            palpate your own data\n"
    "\n"
    "Exit codes: 0 done; 1 a file or setting cannot be used; 2 wrong command line; 3 a figure beyond\n"
    "its limit or a replay that differs; 4 a result could not be written; 5 a data set or the network\n"
    "is missing; 130 interrupted.\n"
    "\n"
    "Research and education, not for clinical use.";

std::string version_text() {
  std::string text =
      "palpate " PALPATE_VERSION " (commit " PALPATE_COMMIT ", " PALPATE_BUILD_TYPE ", " PALPATE_COMPILER;
  if (*PALPATE_SANITIZERS) text += std::string(", ") + PALPATE_SANITIZERS;
  return text + ")";
}

int run(int argc, char** argv) {
  CLI::App app("palpate: feel a patient's scan. Forces computed from the voxels themselves.", "palpate");
  app.footer(kExamples);
  app.set_version_flag("--version", version_text(), "Print version, commit and build, and exit");
  app.require_subcommand(1);
  app.fallthrough();
  Console console;
  app.add_flag("-q,--quiet", console.quiet,
               "No progress and no notes; results, warnings and errors still appear");

  Run verb;
  for (const auto add :
       {add_info, add_data, add_scene, add_prepare, add_simulate, add_replay, add_report, add_verify})
    add(app, verb);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    // help and version are "errors" that succeed
    return app.exit(error) == 0 ? kExitOk : kExitUsage;
  }
  return verb(console);
}

}  // namespace
}  // namespace palpate::app

int main(int argc, char** argv) {
  // a file size limit is met as an error of the write, with a message, and not as a death
  std::signal(SIGXFSZ, SIG_IGN);
  try {
    return palpate::app::run(argc, argv);
  } catch (const std::bad_alloc&) {
    std::fprintf(stderr, "palpate: error: out of memory\n  try a smaller volume or larger voxels\n");
  } catch (const std::exception& error) {
    std::fprintf(stderr, "palpate: bug: %s\n", error.what());
  }
  return palpate::app::kExitBadInput;
}
