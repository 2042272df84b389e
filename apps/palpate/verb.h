#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <functional>
#include <string>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"

/// The command line: one verb a file. A verb adds its subcommand to the application and, when it is
/// chosen, leaves in `run` what is to be done.
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

/// What a verb may say, and how it learns that the user wants it to stop (SIGINT, SIGTERM, SIGHUP).
class Console {
 public:
  /// From here on these signals are remembered, and stop the work that progress() goes with.
  Console();

  bool quiet = false;  ///< -q: no progress and no notes; results, warnings and errors still appear

  Progress progress();  ///< a bar on stderr when that is a terminal, else a line now and then
  /// A line on stderr that the next one replaces and everything else erases, cut to the terminal's width;
  /// an empty one only erases. Nothing when quiet, or where there is no terminal.
  void live(const std::string& line);
  /// What a live line may take.
  std::size_t columns() const;
  Warn warn();                         ///< "palpate: warning: ..." on stderr
  void note(const std::string& text);  ///< a line on stderr unless quiet
  int fail(const Error& error);        ///< prints the error on stderr; returns the exit code of its kind
};

using Run = std::function<int(Console&)>;

/// For options with a number: finite, and from low to high, both included.
CLI::Validator number_between(double low, double high);
/// An option of so many numbers with commas between them, each from -most to most.
CLI::Option* add_numbers(CLI::App& verb, const std::string& name, std::vector<double>& numbers, int count,
                         double most, const std::string& help);
/// The same for whole numbers, written in digits alone.
CLI::Validator whole_between(std::uint64_t low, std::uint64_t high);

void add_info(CLI::App& app, Run& run);
void add_cohort(CLI::App& app, Run& run);
void add_data(CLI::App& app, Run& run);
void add_cache(CLI::App& app, Run& run);
void add_scene(CLI::App& app, Run& run);
void add_prepare(CLI::App& app, Run& run);
void add_forces(CLI::App& app, Run& run);
void add_hold(CLI::App& app, Run& run);
void add_section(CLI::App& app, Run& run);
void add_render(CLI::App& app, Run& run);
void add_simulate(CLI::App& app, Run& run);
void add_explore(CLI::App& app, Run& run);
void add_devices(CLI::App& app, Run& run);
void add_doctor(CLI::App& app, Run& run);
void add_token(CLI::App& app, Run& run);
void add_export(CLI::App& app, Run& run);
void add_replay(CLI::App& app, Run& run);
void add_report(CLI::App& app, Run& run);
void add_register(CLI::App& app, Run& run);
void add_pivot(CLI::App& app, Run& run);
void add_plan(CLI::App& app, Run& run);
void add_records(CLI::App& app, Run& run);
void add_task(CLI::App& app, Run& run);
void add_verify(CLI::App& app, Run& run);

}  // namespace palpate::app
