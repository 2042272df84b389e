#pragma once

#include <functional>
#include <memory>
#include <string>

#include "apps/command/streams.h"
#include "palpate/base/progress.h"
#include "palpate/base/result.h"

/// What the programs of this folder's neighbours share: exit codes, messages, the parsing of a command line.
namespace palpate::app {

/// Documented in `palpate --help` and README.md.
enum ExitCode : int {
  kExitOk = 0,
  kExitBadInput = 1,  ///< a file or a setting cannot be used, or doctor found something missing
  kExitUsage = 2,     ///< the command line does not make sense
  kExitLimit = 3,     ///< a figure beyond its limit, a replay that differs, or a step of a script that failed
  kExitOutput = 4,    ///< a result could not be written
  kExitUnavailable = 5,  ///< a data set or the network is missing
  kExitInterrupted = 130,
};

/// Messages of one run of a verb, and requests to stop it (SIGINT, SIGTERM, SIGHUP). One at a time in a
/// process.
class Console {
 public:
  /// Handles these signals while it lives: the first one stops the work that progress() was given to; the
  /// process ends when a second one arrives, or when the work has not noticed the first within 0.8 s.
  /// @param streams  stdout and stderr of the process lead there (PrintableStreams)
  explicit Console(const Streams& streams);
  ~Console();

  bool quiet = false;  ///< -q: no progress and no notes; results, warnings and errors still appear

  const Streams& streams() const;
  Progress progress();  ///< a bar on stderr when that is a terminal, else a line now and then
  /// A line on stderr that the next one replaces and everything else erases, cut to the terminal's width;
  /// an empty one only erases. Nothing when quiet, or where there is no terminal.
  void live(const std::string& line);
  /// Columns available to a live line.
  std::size_t columns() const;
  Warn warn();                         ///< "palpate: warning: ..." on stderr
  void note(const std::string& text);  ///< a line on stderr unless quiet
  int fail(const Error& error);        ///< prints the error on stderr; returns the exit code of its kind

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// Runs the verb that the command line chose. @return its exit code
using Run = std::function<int(Console&)>;

}  // namespace palpate::app
