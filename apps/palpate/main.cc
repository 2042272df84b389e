#include <algorithm>
#include <csignal>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <iostream>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "palpate/base/reading.h"
#include "palpate/cache/cache.h"
#include "palpate/supervisor/supervisor.h"
#include "palpate/volume_io/volume_io.h"
#include "palpate_version.h"
#include "streams.h"
#include "surroundings.h"
#include "text.h"
#include "verb.h"

namespace palpate::app {
namespace {

constexpr const char* kExamples =
    "Examples:\n"
    "  palpate info knee.seg.nrrd                       what is in a file\n"
    "  palpate simulate knee-phantom --report run.html  palpate a generated knee\n"
    "  palpate explore knee-phantom                     the same in real time\n"
    "  palpate section labels.nii.gz -o three.png       see your own data\n"
    "  palpate scene new scan.nii.gz labels.nii.gz -o scene.toml\n"
    "  palpate simulate scene.toml -o run.h5            palpate them, as the scene says\n"
    "  palpate help simulate                            what a verb takes\n"
    "\n"
    "Exit codes: 0 done; 1 a file or setting cannot be used, or doctor found something missing; 2 wrong\n"
    "command line; 3 a figure beyond its limit, a replay that differs or a step of a script that failed;\n"
    "4 a result could not be written; 5 a data set, a device or the network is missing; 130 interrupted.\n"
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

/// What people type who know other programs, and the verb here that does it.
struct OtherWord {
  std::string_view word;
  const char* command;
};
constexpr OtherWord kOtherWords[] = {
    {"import", "palpate scene new SCAN LABELS -o scene.toml"},
    {"new", "palpate scene new SCAN LABELS -o scene.toml"},
    {"create", "palpate scene new SCAN LABELS -o scene.toml"},
    {"init", "palpate scene new SCAN LABELS -o scene.toml"},
    {"add", "palpate scene new SCAN LABELS -o scene.toml"},
    {"check", "palpate scene check SCENE"},
    {"validate", "palpate scene check SCENE"},
    {"open", "palpate explore FILE"},
    {"load", "palpate explore FILE"},
    {"start", "palpate explore FILE"},
    {"feel", "palpate explore FILE"},
    {"touch", "palpate explore FILE"},
    {"palpate", "palpate explore FILE"},
    {"serve", "palpate explore FILE"},
    {"view",
     "palpate explore FILE, palpate section FILE -o picture.png, or palpate render FILE -o picture.png"},
    {"show",
     "palpate explore FILE, palpate section FILE -o picture.png, or palpate render FILE -o picture.png"},
    {"display",
     "palpate explore FILE, palpate section FILE -o picture.png, or palpate render FILE -o picture.png"},
    {"viewer",
     "palpate explore FILE, palpate section FILE -o picture.png, or palpate render FILE -o picture.png"},
    {"draw", "palpate section FILE -o picture.png, or palpate render FILE -o picture.png"},
    {"plot", "palpate section FILE -o picture.png"},
    {"picture", "palpate section FILE -o picture.png, or palpate render FILE -o picture.png"},
    {"slice", "palpate section FILE -o picture.png"},
    {"run", "palpate simulate FILE"},
    {"press", "palpate simulate FILE"},
    {"record", "palpate simulate FILE -o run.h5, or palpate explore FILE -o run.h5"},
    {"play", "palpate replay RECORDING"},
    {"rerun", "palpate replay RECORDING"},
    {"convert", "palpate prepare FILE -o field.nrrd; other formats are converted by 3D Slicer or dcm2niix"},
    {"export", "palpate prepare FILE -o field.nrrd, or palpate report RECORDING"},
    {"list", "palpate data list"},
    {"ls", "palpate data list"},
    {"download", "palpate data fetch NAME"},
    {"fetch", "palpate data fetch NAME"},
    {"get", "palpate data fetch NAME"},
    {"demo", "palpate simulate knee-phantom --report run.html"},
    {"inspect", "palpate info FILE"},
    {"describe", "palpate info FILE"},
    {"labels", "palpate info FILE"},
    {"test", "palpate verify accuracy"},
    {"diagnose", "palpate doctor"},
    {"diagnostics", "palpate doctor"},
    {"setup", "palpate doctor"},
    {"bench", "palpate verify latency"},
    {"learners", "palpate records list"},
    {"scores", "palpate records list"},
    {"score", "palpate task score RECORDING --task TASK"},
    {"grade", "palpate task score RECORDING --task TASK"},
    {"tasks", "palpate task list"},
    {"rehearse", "palpate plan compare RECORDING --plan PLAN"},
    {"rehearsal", "palpate plan compare RECORDING --plan PLAN"},
    {"training", "palpate task list"},
    {"calibrate", "palpate task calibrate RECORDING... --task TASK"},
    {"password", "palpate token"},
    {"version", "palpate --version"},
};

/// What a word most likely means: a verb, or the command for a word of other programs, spelt right or not;
/// empty where nothing is near. @param first  it stands where one of palpate's own verbs should
std::string meant_by(const std::string& word, const std::vector<std::string>& verbs, bool first) {
  std::vector<std::string> others;
  for (const OtherWord& other : kOtherWords) others.emplace_back(other.word);
  const auto command = [](const std::string& meant) {
    for (const OtherWord& other : kOtherWords)
      if (other.word == meant) return std::string(other.command);
    return std::string();
  };
  if (first && !command(word).empty()) return command(word);
  const std::string verb = nearest(word, verbs);
  return verb.empty() && first ? command(nearest(word, others)) : verb;
}

bool exists(const std::string& path) {
  std::error_code unknown;
  return std::filesystem::exists(path, unknown);
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
  const bool first = chosen.size() == 1 && !is_option;
  const std::string meant = is_option ? nearest(word, options) : meant_by(word, verbs, first);
  if (!meant.empty())
    error.remedy = "did you mean " + meant + "? " + help;
  else if (first && exists(word))
    error = {ErrorKind::kUsage, "is a file, and no verb", word,
             "palpate info FILE says what is in it; " + help};
  return error;
}

/// `palpate help`, `palpate help simulate`, `palpate help data fetch`: the help of that verb.
/// @return the exit code, or nothing where help is not asked for
std::optional<int> help_on(const CLI::App& app, const std::vector<std::string>& words, Console& console) {
  if (words.empty() || words.front() != "help") return std::nullopt;
  const CLI::App* verb = &app;
  std::string above;  // the words before the verb's own
  for (std::size_t n = 1; n < words.size(); ++n) {
    above += (above.empty() ? "" : " ") + verb->get_name();
    const auto verbs = names_of_verbs(*verb);
    if (std::find(verbs.begin(), verbs.end(), words[n]) == verbs.end()) {
      const std::string meant = meant_by(words[n], verbs, verb == &app);
      return console.fail(
          {ErrorKind::kUsage, "unknown verb", words[n],
           (meant.empty() ? "" : "did you mean " + meant + "? ") + above + " --help shows what there is"});
    }
    verb = verb->get_subcommand(words[n]);
  }
  std::fputs(verb->help(above).c_str(), stdout);
  return kExitOk;
}

// help after a word that is no verb would hide the mistake
bool asks_for_help_with_nothing(const CLI::App& app) {
  return !names_of_verbs(*chosen_verbs(app).back()).empty() && !app.remaining(true).empty();
}

/// As two options say it, empty where one was not given.
MeshPlacing mesh_placing_of(const std::string& space, const std::string& unit) {
  MeshPlacing placing;
  if (!space.empty()) placing.space = space == "ras" ? MeshSpace::kRas : MeshSpace::kLps;
  if (!unit.empty()) placing.unit_mm = unit == "mm" ? 1.0 : unit == "cm" ? 10.0 : 1000.0;
  return placing;
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
  ReadingLimits reading;
  app.add_option_function<std::string>(
         "--memory", [&](const std::string& text) { reading.most_memory_bytes = memory_bytes(text); },
         "Most memory that files may take of this machine, as 800M or 4G; default: half of what is available")
      ->check(CLI::Validator(
          [](const std::string& text) {
            return memory_bytes(text) > 0 ? std::string() : "no amount of memory: write it as 800M or 4G";
          },
          "AMOUNT"));
  app.add_flag(
      "--follow-links", reading.follow_links,
      "Headers and scenes may name data files that stand, or are links that lead, outside their folder");

  std::string mesh_space, mesh_unit;
  app.add_option("--mesh-space", mesh_space,
                 "What the axes of surfaces (STL, OBJ, PLY, VTK) are, where their files do not say it")
      ->check(CLI::IsMember({"lps", "ras"}));
  app.add_option("--mesh-unit", mesh_unit, "What the numbers of surfaces are in")
      ->check(CLI::IsMember({"mm", "cm", "m"}));

  bool no_cache = false;
  app.add_flag(
      "--no-cache", no_cache,
      "Read and prepare everything anew, and keep nothing for the next start (palpate cache --help)");

  Run verb;
  for (const auto add : {add_info,     add_data,    add_cache,  add_scene,    add_prepare, add_forces,
                         add_hold,     add_section, add_render, add_simulate, add_explore, add_devices,
                         add_doctor,   add_token,   add_replay, add_export,   add_report,  add_cohort,
                         add_register, add_pivot,   add_plan,   add_task,     add_records, add_verify})
    add(app, verb);
  if (const auto helped = help_on(app, {argv + std::min(argc, 1), argv + argc}, console)) return *helped;
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    // help and version are "errors" that succeed
    const bool asked = error.get_exit_code() == 0 && !asks_for_help_with_nothing(app);
    return asked ? app.exit(error) : console.fail(explain(app, error));
  }
  set_reading_limits(reading);
  set_mesh_placing(mesh_placing_of(mesh_space, mesh_unit));
  if (!no_cache) {
    auto cache = cache_settings_of_environment();
    if (!cache) return console.fail(cache.error());
    cache->warn = console.warn();
    set_cache(*std::move(cache));
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
  // the process that explore starts beside itself
  if (argc > 1 && std::string_view(argv[1]) == "supervise")
    return palpate::supervise({argv + 2, argv + argc});
  palpate::app::distrust_environment();
  palpate::app::show_only_printable();
  // a file size limit is met as an error of the write, with a message, and not as a death
  std::signal(SIGXFSZ, SIG_IGN);
  // a reader that went away is met as one, too
  std::signal(SIGPIPE, SIG_IGN);
  try {
    return palpate::app::after_flushing(palpate::app::run(argc, argv));
  } catch (const std::bad_alloc&) {
    std::fprintf(stderr, "palpate: error: out of memory\n  try a smaller volume or larger voxels\n");
  } catch (const std::system_error& error) {
    // what is thrown where a thread is to begin
    if (error.code() != std::errc::resource_unavailable_try_again) {
      std::fprintf(stderr, "palpate: bug: %s\n", error.what());
      return palpate::app::kExitBadInput;
    }
    std::fprintf(stderr,
                 "palpate: error: no thread is to be had\n"
                 "  close other programs, or raise the limit of processes (ulimit -u)\n");
    return palpate::app::kExitUnavailable;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "palpate: bug: %s\n", error.what());
  }
  return palpate::app::kExitBadInput;
}
