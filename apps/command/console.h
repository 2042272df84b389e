#pragma once

#include <functional>
#include <memory>
#include <string>

#include "apps/command/streams.h"
#include "palpate/base/progress.h"
#include "palpate/base/result.h"

/// Shared by all programs: exit codes, messages, and the type of a verb's function.
namespace palpate::app {

/// Documented in `palpate --help` and README.md.
enum ExitCode : int {
  kExitOk = 0,
  kExitBadInput = 1,  ///< A file or setting is unusable, or doctor found something missing
  kExitUsage = 2,     ///< Invalid command line
  kExitLimit =
      3,  ///< A figure exceeds its limit, a replay differs, a step of a script failed, or labels have a fault
  kExitOutput = 4,       ///< A result could not be written
  kExitUnavailable = 5,  ///< A data set or the network is unavailable
  kExitInterrupted = 130,
};

/// Messages of one run of a verb, and requests to stop it (SIGINT, SIGTERM, SIGHUP). One instance per process
/// at a time.
class Console {
 public:
  /// Handles these signals during its lifetime. The first one stops the work that uses progress(); the
  /// process exits on a second one, or if the work has not reacted to the first within 0.8 s.
  /// @param streams  descriptors to which stdout and stderr of the process are redirected (PrintableStreams)
  explicit Console(const Streams& streams);
  ~Console();

  /// Option -q: no progress and no notes; results, warnings and errors are still printed
  bool quiet = false;

  const Streams& streams() const;
  Progress progress();  ///< Progress bar on stderr if that is a terminal, otherwise occasional lines
  /// Status line on stderr, truncated to the terminal's width. The next one replaces it and any other output
  /// erases it; an empty text only erases. No effect when quiet or without a terminal.
  void show_status(const std::string& line);
  /// Width available to a status line, in columns.
  std::size_t columns() const;
  Warn warn();                         ///< Prints "palpate: warning: ..." on stderr
  void note(const std::string& text);  ///< Prints a line on stderr unless quiet
  int fail(const Error& error);        ///< Prints the error on stderr; returns the exit code of its kind

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// Runs the selected verb. Returns its exit code.
using Run = std::function<int(Console&)>;

}  // namespace palpate::app
