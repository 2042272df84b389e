#pragma once

#include <array>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "apps/command/console.h"
#include "apps/command/streams.h"

namespace CLI {
class App;
}

/// A program as a set of verbs, and the execution of a command line.
namespace palpate::app {

/// A word known from other programs, and the equivalent command.
struct VerbAlias {
  std::string_view word;
  const char* command;
};

/// A verb implemented by a separate executable, palpate-NAME.
struct Companion {
  const char* verb;
  const char* description;
};

/// An option of the program itself, which may stand before or behind its verb.
struct GlobalOption {
  const char* name;
  bool has_value;
  bool is_passed_on;     ///< Passed on to the processes that `palpate cohort` starts
  bool changes_results;  ///< Affects how files are read, so results made without it are not reused
};
/// All global options except --help and --version; run() checks that the parser has the same ones.
inline constexpr std::array kGlobalOptions{
    GlobalOption{"--quiet", false, false, false},      GlobalOption{"--memory", true, true, false},
    GlobalOption{"--follow-links", false, true, true}, GlobalOption{"--mesh-space", true, true, true},
    GlobalOption{"--mesh-unit", true, true, true},     GlobalOption{"--spacing", true, true, true},
    GlobalOption{"--form", true, true, true},          GlobalOption{"--cropped-scan", false, true, true},
    GlobalOption{"--no-cache", false, true, false}};

struct Program {
  const char* examples;  ///< Shown below the help
  std::vector<void (*)(CLI::App&, Run&)> verbs;
  std::vector<Companion> companions;
  std::span<const VerbAlias> verb_aliases;  ///< Suggestions for unknown verbs
};

/// Runs one command line: parses it, runs its verb and flushes the output. Reading limits, mesh placement,
/// cache settings, signal handlers and the process's streams are set as the command line says, and reset to
/// their defaults afterwards. Does not throw or exit, except that a second SIGINT, SIGTERM or SIGHUP ends the
/// process (Console). One run per process at a time.
/// @param arguments  without the program's name
/// @return the exit code
int run(const Program& program, const std::vector<std::string>& arguments, const Streams& streams);

/// Replaces the process by the companion whose verb `arguments` name, with the same standard streams and
/// environment. Returns if they name none, or if it is not installed, which run() then reports. Call it
/// before any output.
void exec_companion(const Program& program, const std::vector<std::string>& arguments);

}  // namespace palpate::app
