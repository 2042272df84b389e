#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"

/// Figures about this build on this machine that anybody can check. See docs/reference/verify.md.
namespace palpate {

struct Figure {
  std::string name;             ///< a path: trilinear/sphere-20mm/0.625x0.625x0.9/direction/mean
  double value = 0;             ///< finite
  std::string unit;             ///< "deg", "percent", "us", ...
  std::uint64_t n = 0;          ///< samples
  std::optional<double> limit;  ///< at most
  bool ok() const { return !limit || value <= *limit; }
};

struct SuiteReport {
  std::string suite;
  std::string machine;                                     ///< processor, cores, SIMD target
  std::string build;                                       ///< version, commit, build type, compiler
  std::string date;                                        ///< on which it was run, UTC: 2026-11-27
  std::vector<std::pair<std::string, std::string>> notes;  ///< what else to know, by name: scheduler, ...
  std::vector<Figure> figures;
  /// Every figure within its limit.
  bool ok() const;
};

/// Names of the suites with a line about each.
std::vector<std::pair<std::string, std::string>> verification_suites();

/// What a person may choose of a suite; `latency` takes all of these, the others none.
struct SuiteOptions {
  std::optional<double> seconds;     ///< of each loop at each rate, 0.05 ... 3600; default 3
  std::optional<double> spin_us;     ///< of both loops before every tick (LoopSettings::spin_s); default 0
  std::optional<double> rate_hz;     ///< this one instead of 1, 2, 4, 8, 10 kHz
  std::optional<std::string> scene;  ///< a catalogue name or a scene file; default knee-phantom
};
/// Errors: kUsage for an unknown suite, with the names of those there are, and for an option out of range or
/// that the suite does not take; those of loading the scene; kInterrupted.
Result<SuiteReport> run_suite(const std::string& suite, const SuiteOptions& options = {},
                              const Progress& progress = {}, const Warn& warn = {});

/// {"suite", "machine", "build", "date", "notes": {name: text},
///  "figures": {name: {"value", "unit", "n", "limit"?}}}
std::string to_json(const SuiteReport& report);
/// The same in a file that appears whole or not at all. Errors are kOutput.
Result<void> write_json(const std::filesystem::path& file, const SuiteReport& report);
/// For people: figures that differ in the last part of their name side by side, a table for each kind of
/// them; of many figures a table for each method, its quantities side by side. Then what is beyond its limit.
std::string to_table(const SuiteReport& report);

}  // namespace palpate
