#include "program.h"

#include <signal.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <charconv>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <iostream>
#include <new>
#include <optional>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "palpate/base/check.h"
#include "palpate/base/reading.h"
#include "palpate/cache/cache.h"
#include "palpate/volume_io/volume_io.h"
#include "palpate_version.h"
#include "signals.h"
#include "text.h"

namespace palpate::app {
namespace {

std::string version_text() {
  std::string text =
      "palpate " PALPATE_VERSION " (commit " PALPATE_COMMIT ", " PALPATE_BUILD_TYPE ", " PALPATE_COMPILER;
  if (*PALPATE_SANITIZERS) text += std::string(", ") + PALPATE_SANITIZERS;
  return text + ")";
}

// the chain of verbs that were parsed: the program, `data`, `fetch`
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

/// Suggestion for an unknown word: a verb, or the command for a word of other programs, misspelled or not;
/// empty if none is close.
/// @param first  whether the word is in the position of one of the program's own verbs
std::string suggestion_for(const Program& program, const std::string& word,
                           const std::vector<std::string>& verbs, bool first) {
  std::vector<std::string> others;
  for (const VerbAlias& other : program.verb_aliases) others.emplace_back(other.word);
  const auto command = [&](const std::string& meant) {
    for (const VerbAlias& other : program.verb_aliases)
      if (other.word == meant) return std::string(other.command);
    return std::string();
  };
  if (first && !command(word).empty()) return command(word);
  const std::string verb = closest_match(word, verbs);
  return verb.empty() && first ? command(closest_match(word, others)) : verb;
}

bool exists(const std::string& path) {
  std::error_code unknown;
  return std::filesystem::exists(path, unknown);
}

/// Error for a command line that the parser rejected, with the word that most likely caused it.
Error describe_parse_error(const Program& program, const CLI::App& app, const CLI::ParseError& refusal) {
  const auto chosen = chosen_verbs(app);
  std::string command;
  std::vector<std::string> options;
  for (const CLI::App* verb : chosen) {
    command += (command.empty() ? "" : " ") + verb->get_name();
    for (const CLI::Option* option : verb->get_options())
      for (const std::string& name : option->get_lnames()) options.push_back("--" + name);
  }
  const auto verbs = names_of_verbs(*chosen.back());
  const std::string help = command + " --help shows " + (verbs.empty() ? "its options" : "the verbs");
  const auto unknown = app.remaining(true);
  if (unknown.empty())
    return {ErrorKind::kUsage, verbs.empty() ? refusal.what() : command + " needs a verb", "", help};

  const std::string& word = unknown.front();
  const bool is_option = word.starts_with("-");
  Error error{ErrorKind::kUsage, is_option ? "unknown option" : "unexpected argument", word, help};
  if (!is_option && !verbs.empty()) error.what = "unknown verb";
  const bool first = chosen.size() == 1 && !is_option;
  const std::string meant =
      is_option ? closest_match(word, options) : suggestion_for(program, word, verbs, first);
  if (!meant.empty())
    error.remedy = "did you mean " + meant + "? " + help;
  else if (first && exists(word))
    error = {ErrorKind::kUsage, "is a file, not a verb", word,
             "palpate info FILE shows its contents; " + help};
  return error;
}

/// Help of a verb: `palpate help`, `palpate help simulate`, `palpate help data fetch`.
/// @return the exit code; empty if no help was requested
std::optional<int> help_on(const Program& program, const CLI::App& app, const std::vector<std::string>& words,
                           Console& console) {
  if (words.empty() || words.front() != "help") return std::nullopt;
  const CLI::App* verb = &app;
  std::string above;  // words before the name of the verb
  for (std::size_t n = 1; n < words.size(); ++n) {
    above += (above.empty() ? "" : " ") + verb->get_name();
    const auto verbs = names_of_verbs(*verb);
    if (std::find(verbs.begin(), verbs.end(), words[n]) == verbs.end()) {
      const std::string meant = suggestion_for(program, words[n], verbs, verb == &app);
      return console.fail(
          {ErrorKind::kUsage, "unknown verb", words[n],
           (meant.empty() ? "" : "did you mean " + meant + "? ") + above + " --help shows the verbs"});
    }
    verb = verb->get_subcommand(words[n]);
  }
  std::fputs(verb->help(above).c_str(), stdout);
  return kExitOk;
}

// showing help after an unknown verb would hide the mistake
bool is_help_on_unknown_verb(const CLI::App& app) {
  return !names_of_verbs(*chosen_verbs(app).back()).empty() && !app.remaining(true).empty();
}

/// Mesh placement given by two options; an empty string means not given.
MeshPlacementOptions mesh_placement_options_of(const std::string& space, const std::string& unit) {
  MeshPlacementOptions placement_options;
  if (!space.empty()) placement_options.space = space == "ras" ? MeshSpace::kRas : MeshSpace::kLps;
  if (!unit.empty()) placement_options.unit_mm = unit == "mm" ? 1.0 : unit == "cm" ? 10.0 : 1000.0;
  return placement_options;
}

/// Checks that kGlobalOptions and the parser's global options are the same.
void check_global_options(const CLI::App& app) {
  std::size_t listed = 0;
  for (const GlobalOption& global : kGlobalOptions) {
    const CLI::Option* option = app.get_option_no_throw(global.name);
    PALPATE_CHECK(option != nullptr && (option->get_items_expected_min() > 0) == global.has_value);
    ++listed;
  }
  constexpr std::size_t kHelpAndVersion = 2;
  PALPATE_CHECK(app.get_options().size() == listed + kHelpAndVersion);
}

/// Spacing in mm between columns, rows and slices: "0.05,0.05,0.1"; a single number applies to all three.
/// Empty if invalid.
std::optional<Eigen::Vector3d> spacing_of(const std::string& text) {
  std::vector<double> values;
  for (std::size_t at = 0; at <= text.size();) {
    const std::size_t end = std::min(text.find(',', at), text.size());
    double value = 0;
    const auto [last, failed] = std::from_chars(text.data() + at, text.data() + end, value);
    constexpr double kMin_mm = 1e-4, kMax_mm = 100;
    if (failed != std::errc() || last != text.data() + end || !(value >= kMin_mm && value <= kMax_mm))
      return std::nullopt;
    values.push_back(value);
    at = end + 1;
  }
  if (values.size() == 1) return Eigen::Vector3d::Constant(values.front());
  if (values.size() != 3) return std::nullopt;
  return Eigen::Vector3d(values.data());
}

/// Index of the verb on a command line, after options of the program; the number of arguments if there is
/// none.
std::size_t index_of_verb(const std::vector<std::string>& arguments) {
  std::size_t n = 0;
  while (n < arguments.size() && arguments[n].starts_with("-")) {
    const std::string& option = arguments[n];
    const auto global = std::ranges::find(kGlobalOptions, option, &GlobalOption::name);
    n += global != kGlobalOptions.end() && global->has_value ? 2 : 1;
  }
  return std::min(n, arguments.size());
}

struct CompanionCall {
  std::string verb;
  std::vector<std::string> arguments;  // arguments of palpate-VERB
};

/// The companion that a command line selects: `palpate [OPTIONS] verify ...`, `palpate help verify`.
std::optional<CompanionCall> companion_of(const Program& program, const std::vector<std::string>& arguments) {
  const std::size_t index = index_of_verb(arguments);
  const bool help = index < arguments.size() && arguments[index] == "help";
  const std::size_t at = index + (help ? 1 : 0);
  for (const Companion& companion : program.companions) {
    if (at >= arguments.size() || arguments[at] != companion.verb) continue;
    CompanionCall call{companion.verb, arguments};
    call.arguments.erase(call.arguments.begin() + static_cast<std::ptrdiff_t>(at));
    if (help) call.arguments[index] = "--help";
    return call;
  }
  return std::nullopt;
}

/// Reports a companion that is not installed; its help states its purpose and how to install it.
int missing(const Program& program, const CompanionCall& call, Console& console) {
  const std::string name = "palpate-" + call.verb;
  const std::string remedy = "build the target " + name + ", or install it in the same folder as palpate";
  if (std::ranges::any_of(call.arguments, [](const std::string& a) { return a == "--help" || a == "-h"; })) {
    const auto companion = std::ranges::find(program.companions, call.verb, &Companion::verb);
    std::printf("%s\n\n%s is a separate program, which is not installed: %s.\n", companion->description,
                name.c_str(), remedy.c_str());
    return kExitOk;
  }
  return console.fail(
      {ErrorKind::kUnavailable, "is a separate program, which is not installed", name, remedy});
}

int run_verb(const Program& program, const std::vector<std::string>& arguments, Console& console) {
  CLI::App app("palpate: feel a patient's scan. Forces computed from the voxels themselves.", "palpate");
  app.set_version_flag("--version", version_text(), "Print version, commit and build, and exit");
  app.require_subcommand(1);
  app.fallthrough();
  app.add_flag("-q,--quiet", console.quiet,
               "Suppress progress and notes; results, warnings and errors still appear");
  ReadingLimits reading;
  app.add_option_function<std::string>(
         "--memory", [&](const std::string& text) { reading.max_memory_bytes = parse_memory_size(text); },
         "Maximum memory for reading files, such as 800M or 4G; default: half of the available memory")
      ->check(CLI::Validator(
          [](const std::string& text) {
            return parse_memory_size(text) > 0 ? std::string()
                                               : "not an amount of memory: write it as 800M or 4G";
          },
          "AMOUNT"));
  app.add_flag(
      "--follow-links", reading.follow_links,
      "Allow headers and scenes to refer to data files outside their folder, by path or by symbolic link");

  std::string mesh_space, mesh_unit;
  app.add_option("--mesh-space", mesh_space,
                 "Axes of surfaces (STL, OBJ, PLY, VTK) whose files do not specify them")
      ->check(CLI::IsMember({"lps", "ras"}));
  app.add_option("--mesh-unit", mesh_unit, "Unit of the coordinates of surfaces")
      ->check(CLI::IsMember({"mm", "cm", "m"}));
  PlacementOptions placement_options;
  app.add_option_function<std::string>(
         "--spacing", [&](const std::string& text) { placement_options.image_spacing_mm = spacing_of(text); },
         "Voxel spacing of an image stack (PNG, TIFF, JPEG): mm between columns, rows and slices")
      ->check(CLI::Validator(
          [](const std::string& text) {
            return spacing_of(text) ? std::string()
                                    : "not a spacing: give three numbers from 0.0001 to 100 mm, such as "
                                      "0.05,0.05,0.1, or one for all axes";
          },
          "X,Y,Z"));
  app.add_option_function<std::string>(
         "--form",
         [&](const std::string& text) {
           placement_options.nifti_form = text == "q" ? NiftiForm::kQform : NiftiForm::kSform;
         },
         "Transform to use for a NIfTI file that has both a qform and an sform; default: the sform")
      ->check(CLI::IsMember({"q", "s"}));
  app.add_flag(
      "--cropped-scan", placement_options.scan_is_cropped,
      "The scan covers only part of the labelled region: more than half of the labels may lie outside it");

  bool no_cache = false;
  app.add_flag("--no-cache", no_cache,
               "Neither read nor write the cache of prepared scenes (palpate cache --help)");

  check_global_options(app);
  Run verb;
  for (const auto add : program.verbs) add(app, verb);
  // set after the verbs, which would inherit it
  app.footer(program.examples);
  for (const Companion& companion : program.companions)
    app.add_subcommand(companion.verb, companion.description);
  if (const auto call = companion_of(program, arguments)) return missing(program, *call, console);
  if (const auto helped = help_on(program, app, arguments, console)) return *helped;
  try {
    app.parse(std::vector<std::string>(arguments.rbegin(), arguments.rend()));
  } catch (const CLI::ParseError& error) {
    // help and version are reported as errors with exit code 0
    const bool requested = error.get_exit_code() == 0 && !is_help_on_unknown_verb(app);
    return requested ? app.exit(error) : console.fail(describe_parse_error(program, app, error));
  }
  set_reading_limits(reading);
  placement_options.mesh = mesh_placement_options_of(mesh_space, mesh_unit);
  set_placement_options(placement_options);
  if (!no_cache) {
    auto cache = cache_settings_of_environment();
    if (!cache) return console.fail(cache.error());
    cache->warn = console.warn();
    set_cache(*std::move(cache));
  }
  return verb(console);
}

/// Resets process-wide settings of a command line to their defaults.
struct DefaultSettings {
  ~DefaultSettings() {
    set_reading_limits({});
    set_placement_options({});
    set_read_as(ReadAs::kByContent);
    set_cache({});
  }
};

/// Calls run_verb() and reports exceptions as messages.
int run_caught(const Program& program, const std::vector<std::string>& arguments, const Streams& streams) {
  try {
    Console console(streams);
    // destroyed before the console, because the cache's warnings use the console
    const DefaultSettings afterwards;
    return run_verb(program, arguments, console);
  } catch (const std::bad_alloc&) {
    std::fprintf(stderr, "palpate: error: out of memory\n  try a smaller volume or larger voxels\n");
  } catch (const std::system_error& error) {
    // std::thread throws this if no thread can be started
    if (error.code() != std::errc::resource_unavailable_try_again) {
      std::fprintf(stderr, "palpate: bug: %s\n", error.what());
      return kExitBadInput;
    }
    std::fprintf(stderr,
                 "palpate: error: cannot start a thread\n"
                 "  close other programs, or raise the process limit (ulimit -u)\n");
    return kExitUnavailable;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "palpate: bug: %s\n", error.what());
  }
  return kExitBadInput;
}

}  // namespace

int run(const Program& program, const std::vector<std::string>& arguments, const Streams& streams) {
  // file size limits and closed pipes become write errors with a message
  const ScopedSignals as_errors({SIGXFSZ, SIGPIPE}, SIG_IGN);
  std::optional<PrintableStreams> printable;
  try {
    printable.emplace(streams);
  } catch (const std::bad_alloc&) {
    return kExitBadInput;
  }
  const int code = run_caught(program, arguments, streams);
  // lost output is a failure
  if (printable->flush() || code != kExitOk) return code;
  std::fprintf(
      stderr,
      "palpate: error: standard output: cannot be written\n  is the disk full, or the pipe closed?\n");
  return kExitOutput;
}

void exec_companion(const Program& program, const std::vector<std::string>& arguments) {
  auto call = companion_of(program, arguments);
  std::error_code failed;
  const std::filesystem::path self = std::filesystem::read_symlink("/proc/self/exe", failed);
  if (!call || failed) return;
  const std::string name = "palpate-" + call->verb;
  // locations in a build folder, in an installation, and in a distribution's layout
  for (const std::filesystem::path& folder :
       {self.parent_path(), self.parent_path().parent_path() / "libexec/palpate"}) {
    const std::string file = folder / name;
    std::vector<char*> argv{const_cast<char*>(file.c_str())};
    for (std::string& argument : call->arguments) argv.push_back(argument.data());
    argv.push_back(nullptr);
    ::execv(file.c_str(), argv.data());
  }
}

}  // namespace palpate::app
