#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"
#include "palpate/cohort/cohort_table.h"
#include "palpate/geometry/geometry.h"

namespace palpate {

/// Marks a value that is not available.
inline constexpr double kNotAvailable = std::numeric_limits<double>::quiet_NaN();

/// Figures of one structure of a case.
struct StructureResult {
  std::string name;
  double volume_mm3 = 0;
  /// Number of connected components.
  int components = 0;
  double thinnest_mm = kNotAvailable;
  /// Number of gaps through which a point may slip (palpate/surfaces/surfaces.h, Leaks)
  std::size_t gaps = 0;
  bool touchable = false;
  /// Palpation by the script (HoldFigure); NaN if not palpated.
  double held_s = kNotAvailable, mean_force_N = kNotAvailable, peak_force_N = kNotAvailable;
};

/// Result of a case. It contains no times, no paths and no text of the case's files except names of
/// structures.
struct CaseResult {
  std::string key;    ///< Hash of all inputs (case_key)
  std::string fault;  ///< Reason for a missing result or palpation; empty: complete
  std::array<int, 3> dims{0, 0, 0};
  Eigen::Vector3d spacing_mm = Eigen::Vector3d::Zero();
  std::vector<StructureResult> structures;  ///< In the model's order; empty: the case could not be read
  int palpated = 0, held = 0;  ///< Number of structures that the script touches, and of those held for 0.1 s
  int failed_steps = 0;
  double largest_force_N = kNotAvailable;
  std::uint64_t ticks = 0, run_hash = 0;
  std::vector<std::string> notes;  ///< Warnings and failed steps
};
/// Durations, s; separate from the results, which are the same on every machine.
struct CaseTimes {
  double read_s = 0, check_s = 0, palpate_s = 0, picture_s = 0;
};

/// An input file of a case.
struct CaseFile {
  std::string role;            ///< Role of the file, including its name where that affects the result
  std::filesystem::path file;  ///< Empty: the cohort's table, of which only the presence counts
};
/// All files that the row names and those read together with them: files of a scene, colour tables next to
/// labels (every .ctbl and .tsv, because a single one is read and several are ignored), data files of
/// headers.
std::vector<CaseFile> case_files(const CohortCase& cohort_case);

/// SHA-256, in hexadecimal, of the case's row, of the roles, names and contents of case_files, and of the
/// program. Errors: an unreadable file; interrupted.
/// @param program  version and commit, and those options that affect results
Result<std::string> case_key(const CohortCase& cohort_case, const std::string& program,
                             const Progress& progress = {});

/// Removes identifying names from a text: paths and names of the case's files, of files named by their
/// headers and scenes, of other files in their folders, of the folders of the table and the cohort, in the
/// original spelling and in that of printable_name(); and any other word with a '/' or a file extension.
/// Common folder names ("data") and names that consist of anatomical terms only are kept.
std::string without_names(std::string text, const CohortCase& cohort_case,
                          const std::filesystem::path& cohort = {});

/// Serialises a result for result.json.
std::string case_json(const CaseResult& result);
/// Parses and validates a result; the text is untrusted. Empty if it is not a result.
std::optional<CaseResult> parse_case_json(std::string_view text);

/// Folder with the results of case `number`, counted from 1.
std::filesystem::path case_folder(const std::filesystem::path& cohort, int number);
/// Stored result of a case if it exists and has this key.
std::optional<CaseResult> find_case(const std::filesystem::path& cohort, int number, const std::string& key);

struct CaseOptions {
  std::string program;     ///< Program version, as for case_key
  bool recording = false;  ///< Whether run.h5 is kept
};
/// Reads, checks, palpates and renders a case in this process, and writes result.json, times.json,
/// picture.png and optionally run.h5 into its folder. A failure of the case is a result as well. Errors:
/// kOutput, kInterrupted.
Result<CaseResult> run_case(const CohortCase& cohort_case, int number, const std::filesystem::path& cohort,
                            const CaseOptions& options, const Progress& progress = {});
/// Writes a failed result for a case whose process ended without one.
Result<void> write_fault(const CohortCase& cohort_case, int number, const std::filesystem::path& cohort,
                         const std::string& key, const std::string& fault);

}  // namespace palpate
