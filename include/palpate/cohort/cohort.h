#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/base/force_method.h"
#include "palpate/base/progress.h"
#include "palpate/contact/model.h"
#include "palpate/geometry/geometry.h"
#include "palpate/volume/volume.h"

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

// ---- the table ------------------------------------------------------------------------------------------

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

// ---- a case ---------------------------------------------------------------------------------------------

/// Marks a value that is not available.
inline constexpr double kNotAvailable = std::numeric_limits<double>::quiet_NaN();

/// Location of minimum thickness of a structure.
struct ThinSpot {
  double thickness_mm = 0;
  Point<Patient> position;
};
/// Minimum thickness of a structure, measured on its medial surface: voxels whose nearest outside voxels are
/// on opposite sides (at least 130 degrees apart). The thickness is the distance of these minus one voxel; a
/// plate of n voxels has thickness n. Rims taper off, so a medial voxel counts only if the medial surface
/// continues on all sides within kRim_mm. Protrusions of a thicker part by at most one voxel are ignored. The
/// boundary of the volume is not a side. Empty if there is no such voxel (a structure of a few voxels, or one
/// that fills the volume).
/// @param labels  flattened
std::optional<ThinSpot> minimum_thickness(const Volume<LabelId>& labels, const SegmentStatistics& structure);
/// Radius within which the medial surface has to continue on all sides.
inline constexpr double kRim_mm = 3;

/// Euclidean distance transform with feature indices: squared distance, mm2, of every voxel of a box to the
/// nearest voxel centre that is `outside`, and the index of that voxel (Felzenszwalb and Huttenlocher 2012,
/// separable). i varies fastest. -1: there is none.
struct NearestOutside {
  std::vector<float> squared_mm2;
  std::vector<std::int32_t> index;
};
NearestOutside nearest_outside(const std::array<int, 3>& dims, const Eigen::Vector3d& spacing_mm,
                               const std::vector<std::uint8_t>& outside);

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
std::vector<CaseFile> case_files(const CohortCase& one);

/// SHA-256, in hexadecimal, of the case's row, of the roles, names and contents of case_files, and of the
/// program. Errors: an unreadable file; interrupted.
/// @param program  version and commit, and those options that affect results
Result<std::string> case_key(const CohortCase& one, const std::string& program,
                             const Progress& progress = {});

/// Removes identifying names from a text: paths and names of the case's files, of files named by their
/// headers and scenes, of other files in their folders, of the folders of the table and the cohort, in the
/// original spelling and in that of printable_name(); and any other word with a '/' or a file extension.
/// Common folder names ("data") and names that consist of anatomical terms only are kept.
std::string without_names(std::string text, const CohortCase& one, const std::filesystem::path& cohort = {});

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
Result<CaseResult> run_case(const CohortCase& one, int number, const std::filesystem::path& cohort,
                            const CaseOptions& options, const Progress& progress = {});
/// Writes a failed result for a case whose process ended without one.
Result<void> write_fault(const CohortCase& one, int number, const std::filesystem::path& cohort,
                         const std::string& key, const std::string& fault);

// ---- engines --------------------------------------------------------------------------------------------

/// Exit status and error output of a case's process.
struct EndedProcess {
  int exit_code = 0;  ///< -1 if terminated by a signal
  int signal = 0;
  std::string error_output;  ///< Last 4 KiB of stderr
};
/// Runs a process and waits for it. It is killed when this process ends, and receives SIGTERM when progress
/// is stopped.
Result<EndedProcess> run_process(const std::vector<std::string>& command, const Progress& progress = {});

/// Runs `command` with the number of each case appended, several at a time on this machine, each in its own
/// process group; they are killed when this process ends. On interruption all receive SIGTERM and are waited
/// for.
/// @param jobs   maximum number at a time; 0: number of processors
/// @param ended  called after each process with its number and exit status
Result<void> run_locally(const std::vector<std::string>& command, const std::vector<int>& numbers, int jobs,
                         const std::function<void(int number, const EndedProcess& how)>& ended,
                         const Progress& progress = {});

struct SlurmOptions {
  int jobs = 0;                     ///< Maximum number of tasks at a time; 0: decided by Slurm
  std::vector<std::string> sbatch;  ///< Additional options of sbatch: "--partition=long"
  /// Folder of the cohort; its file "slurm-job" holds the id of a job that has not been collected
  std::filesystem::path folder;
  /// Maximum time, s, to wait for results that a node has written and that are not yet visible on this
  /// machine.
  double late_s = 60;
};
/// Runs the cases as one array job of Slurm, with the case numbers as task ids, and waits for it. If a job of
/// an earlier call is still running for this folder it is awaited first, and `numbers` is evaluated
/// afterwards. On interruption the job is cancelled; "slurm-job" remains unless the job is gone by then.
/// @param numbers  cases that are not done; called when the job is submitted
/// @param look     called periodically; returns the number of cases without a result
/// Errors: kUnavailable, with Slurm's message, if Slurm is missing, does not respond or rejects the job.
Result<void> run_by_slurm(const std::vector<std::string>& command,
                          const std::function<std::vector<int>()>& numbers, const SlurmOptions& options,
                          const std::function<std::size_t()>& look, const Progress& progress = {});
/// Error if a Slurm job is still running in the cohort's folder, or if its state cannot be determined. The
/// job file of a finished job is removed.
Result<void> check_no_slurm_job(const std::filesystem::path& cohort);

// ---- summary --------------------------------------------------------------------------------------------

/// All cases of a table with their results.
struct CohortResults {
  std::vector<CohortCase> cases;
  std::vector<std::optional<CaseResult>> results;  ///< Result of each case; empty: not done
};
/// Table with a row per case and a column per figure, followed by those of each structure. Deterministic.
std::string cohort_tsv(const CohortResults& cohort);
/// Durations of each case, from its times.json; s.
std::string times_tsv(const CohortResults& cohort, const std::filesystem::path& folder);
/// HTML page with sorting and comparison, including the cases' pictures.
std::string cohort_page(const CohortResults& cohort, const std::filesystem::path& folder,
                        const std::string& program);

}  // namespace palpate
