#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/base/force_method.h"
#include "palpate/base/result.h"

/// Batch processing of many studies: each is prepared, checked and palpated by a script, and the results are
/// compared.
///
///     table -> cases -> one process per case (run_cases, on this machine or by Slurm) -> CASE/result.json
///                                                                                          |
///                                                    cohort.tsv, times.tsv, index.html <---+
///
/// The processes communicate only through the file system: the result that a case's process has written
/// atomically is valid wherever it ran.
namespace palpate {

/// A row of the table.
struct CohortCase {
  int line = 0;                 ///< Line in the table
  std::string name;             ///< Name from the column "case", otherwise its number; shown in all output
  std::filesystem::path table;  ///< Table that contains the row; empty: not read from a file
  /// A scan, a folder of DICOM files, a label map, a scene, or the name of a data set; with segmentation,
  /// names and volume it forms a SceneSource.
  std::string target;
  std::optional<std::filesystem::path> segmentation, names, script;
  std::optional<int> volume;
  std::optional<ForceMethod> method;
  std::optional<double> max_force_N, rate_hz;
  std::optional<std::uint64_t> seed;
};

/// Parses a table with a header line; fields are separated by tabs, commas or semicolons and may be quoted.
/// Columns in any order: `study` (or `scan`, `scene`, `target`), required; `case`, `segmentation` (or
/// `labels`), `names`, `script`, `volume`, `method`, `max_force` (N), `rate` (Hz), `seed`. Empty fields and
/// "n/a" count as absent. Lines that begin with # and empty lines are skipped.
/// @param folder       base folder of relative paths in the table
/// @param is_data_set  whether a study is the name of a data set and not a path; empty: never
/// Errors, with the line: an unknown or missing column, a value out of range, a duplicate name, no case, more
/// than kMaxCases.
Result<std::vector<CohortCase>> parse_cohort_table(
    std::string_view text, const std::string& source, const std::filesystem::path& folder,
    const std::function<bool(const std::string&)>& is_data_set = {});
/// Loads a table; names of the catalogue's data sets are accepted.
Result<std::vector<CohortCase>> load_cohort_table(const std::filesystem::path& file);
inline constexpr std::size_t kMaxCases = 100'000;

}  // namespace palpate
