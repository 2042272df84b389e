#include <csignal>
#include <cstdio>
#include <exception>
#include <iostream>
#include <string>
#include <vector>

#include "palpate_version.h"
#include "text.h"
#include "verb.h"

namespace palpate::app {
namespace {

constexpr const char* kExamples =
    "Examples:\n"
    "  palpate info knee.seg.nrrd                       what is in a file\n"
    "  palpate simulate knee-phantom --report run.html  palpate a generated knee\n"
    "  palpate explore knee-phantom                     the same in real time\n"
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

// the verbs that the command line got to: the program, `data`, `fetch`
std::vector<const CLI::App*> chosen_verbs(const CLI::App& app) {
  std::vector<const CLI::App*> chosen{&app};
  while (true) {
    const auto next = chosen.back()->get_subcommands();
    if (next.empty()) return chosen;
    chosen.push_back(next.front());
  }
}

std::vector<std::string> names_of_verbs(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::App* verb : app.get_subcommands({})) names.push_back(verb->get_name());
  return names;
}

/// What is wrong with a command line that the parser refused, with the word that it most likely is about.
Error explain(const CLI::App& app, const CLI::ParseError& refusal) {
  const auto chosen = chosen_verbs(app);
  std::string command;
  std::vector<std::string> options;
  for (const CLI::App* verb : chosen) {
    command += (command.empty() ? "" : " ") + verb->get_name();
    for (const CLI::Option* option : verb->get_options())
      for (const std::string& name : option->get_lnames()) options.push_back("--" + name);
  }
  const auto verbs = names_of_verbs(*chosen.back());
  const std::string help = command + " --help shows " + (verbs.empty() ? "what it takes" : "what there is");
  const auto unknown = app.remaining(true);
  if (unknown.empty())
    return {ErrorKind::kUsage, verbs.empty() ? refusal.what() : command + " needs a verb", "", help};

  const std::string& word = unknown.front();
  const bool is_option = word.starts_with("-");
  Error error{ErrorKind::kUsage, is_option ? "unknown option" : "unexpected argument", word, help};
  if (!is_option && !verbs.empty()) error.what = "unknown verb";
  const std::string meant = nearest(word, is_option ? options : verbs);
  if (!meant.empty()) error.remedy = "did you mean " + meant + "? " + help;
  return error;
}

// help after a word that is no verb would hide the mistake
bool asks_for_help_with_nothing(const CLI::App& app) {
  return !names_of_verbs(*chosen_verbs(app).back()).empty() && !app.remaining(true).empty();
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
  for (const auto add : {add_info, add_data, add_scene, add_prepare, add_forces, add_hold, add_section,
                         add_simulate, add_explore, add_replay, add_report, add_verify})
    add(app, verb);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    // help and version are "errors" that succeed
    const bool asked = error.get_exit_code() == 0 && !asks_for_help_with_nothing(app);
    return asked ? app.exit(error) : console.fail(explain(app, error));
  }
  return verb(console);
}

/// The exit code, once what was printed has got out: a result that is lost is a failure.
int after_flushing(int code) {
  std::cout.flush();
  const bool written = std::fflush(stdout) == 0 && std::ferror(stdout) == 0 && std::cout.good();
  if (written || code != kExitOk) return code;
  std::fprintf(
      stderr,
      "palpate: error: standard output: cannot be written\n  is the disk full, or the pipe closed?\n");
  return kExitOutput;
}

}  // namespace
}  // namespace palpate::app

int main(int argc, char** argv) {
  // a file size limit is met as an error of the write, with a message, and not as a death
  std::signal(SIGXFSZ, SIG_IGN);
  try {
    return palpate::app::after_flushing(palpate::app::run(argc, argv));
  } catch (const std::bad_alloc&) {
    std::fprintf(stderr, "palpate: error: out of memory\n  try a smaller volume or larger voxels\n");
  } catch (const std::exception& error) {
    std::fprintf(stderr, "palpate: bug: %s\n", error.what());
  }
  return palpate::app::kExitBadInput;
}
