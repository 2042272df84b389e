#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "apps/command/console.h"
#include "apps/command/streams.h"

namespace CLI {
class App;
}

/// A program as a set of verbs, and how a command line runs one of them.
namespace palpate::app {

/// A word known from other programs, and the command that does the same here.
struct OtherWord {
  std::string_view word;
  const char* command;
};

/// A verb that is a program of its own, palpate-NAME.
struct Companion {
  const char* verb;
  const char* description;
};

struct Program {
  const char* examples;  ///< below the help
  std::vector<void (*)(CLI::App&, Run&)> verbs;
  std::vector<Companion> companions;
  std::span<const OtherWord> other_words;  ///< suggested in place of an unknown verb
};

/// Runs one command line: parses it, runs its verb and flushes what was printed. Limits of reading, placing
/// of meshes, cache, signal handlers and the process's streams are as the command line says meanwhile, and as
/// they were by default afterwards. Never throws or exits; but a second SIGINT, SIGTERM or SIGHUP ends the
/// process (Console). One at a time in a process.
/// @param arguments  without the program's name
/// @return the exit code
int run(const Program& program, const std::vector<std::string>& arguments, const Streams& streams);

/// Replaces the process by the companion whose verb `arguments` name, with the same standard streams and
/// environment. Returns where they name none, or it is not installed: run() then says so. To be called before
/// anything is printed.
void exec_companion(const Program& program, const std::vector<std::string>& arguments);

}  // namespace palpate::app
