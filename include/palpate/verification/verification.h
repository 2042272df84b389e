#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"

/// Verification figures of this build on this machine, reproducible by anybody. See docs/reference/verify.md.
namespace palpate {

/// A measured value with its limit.
struct Figure {
  /// Name, a path: trilinear/sphere-20mm/0.625x0.625x0.9/direction/mean
  std::string name;
  double value = 0;             ///< Value; finite
  std::string unit;             ///< Unit, e.g. "deg", "percent", "us"
  std::uint64_t n = 0;          ///< Number of samples
  std::optional<double> limit;  ///< Upper limit, if any
  bool ok() const { return !limit || value <= *limit; }
};

/// Result of a suite.
struct SuiteReport {
  std::string suite;
  std::string machine;                                     ///< Processor, cores, SIMD target
  std::string build;                                       ///< Version, commit, build type, compiler
  std::string date;                                        ///< Date of the run, UTC: 2026-11-27
  std::vector<std::pair<std::string, std::string>> notes;  ///< Additional information by name: scheduler, ...
  std::vector<Figure> figures;
  /// Whether every figure is within its limit.
  bool ok() const;
};

/// Names of the suites with a one-line description each.
std::vector<std::pair<std::string, std::string>> verification_suites();

/// User options of a suite. `curves` applies to `outside` and is required there; all others to `latency`.
struct SuiteOptions {
  std::optional<double> seconds;  ///< Duration of each loop at each rate, 0.05 ... 3600; default 3
  /// Busy-wait of both loops before every tick (LoopSettings::spin_s); default 0
  std::optional<double> spin_us;
  std::optional<double> rate_hz;                ///< Single rate instead of 1, 2, 4, 8, 10 kHz
  std::optional<std::string> scene;             ///< Catalogue name or scene file; default knee-phantom
  std::optional<std::filesystem::path> curves;  ///< Measured indentation curves (docs/guide/fit.md)
};
/// Runs a suite. Errors: kUsage for an unknown suite, with the names of the known ones, and for an option out
/// of range or not applicable; those of loading the scene; kInterrupted.
Result<SuiteReport> run_suite(const std::string& suite, const SuiteOptions& options = {},
                              const Progress& progress = {}, const Warn& warn = {});

/// JSON of the form {"suite", "machine", "build", "date", "notes": {name: text},
///  "figures": {name: {"value", "unit", "n", "limit"?}}}
std::string to_json(const SuiteReport& report);
/// Writes to_json atomically. Errors are kOutput.
Result<void> write_json(const std::filesystem::path& file, const SuiteReport& report);
/// Text table: figures whose names differ only in the last part are in one row, with one table per set of
/// columns; a long table is split by method, with its quantities side by side. Followed by the figures beyond
/// their limits.
std::string to_table(const SuiteReport& report);

}  // namespace palpate
