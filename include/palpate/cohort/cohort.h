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
#include "palpate/geometry/geometry.h"
#include "palpate/haptics/haptics.h"
#include "palpate/volume/volume.h"

/// Many studies, each prepared, checked and palpated by a script, and compared.
///
///     table -> cases -> a process each (run_cases, on this machine or by Slurm) -> CASE/result.json
///                                                                                    |
///                                              cohort.tsv, times.tsv, index.html <---+
///
/// Nothing but the file system stands between the processes: what a case's process has written, whole, is its
/// result, wherever it ran.
namespace palpate {

// ---- the table ------------------------------------------------------------------------------------------

/// A row of the table.
struct CohortCase {
  int line = 0;                 ///< of the table
  std::string name;             ///< of the column "case", else its number; shown in every output
  std::filesystem::path table;  ///< that it stands in; empty: none that was read as a file
  /// A scan, a folder of DICOM, a label map, a scene, or a data set's name.
  std::string target;
  std::optional<std::filesystem::path> segmentation, script;
  std::optional<int> volume;
  std::optional<ForceMethod> method;
  std::optional<double> max_force_N, rate_hz;
  std::optional<std::uint64_t> seed;
};

/// Parses a table with a header line; tab-separated, or with commas or semicolons, a field perhaps in
/// quotation marks. Columns in any order: `study` (or `scan`, `scene`, `target`), needed; `case`,
/// `segmentation` (or `labels`), `script`, `volume`, `method`, `max_force` (N), `rate` (Hz), `seed`. Empty
/// fields and "n/a" are not given. Lines that begin with # and empty ones are passed over.
/// @param folder       what relative paths in it start from
/// @param is_data_set  whether a study is a data set's name and no path; none: it never is
/// Errors, with the line: an unknown or missing column, a value out of range, a name twice, no case, more
/// than kMaxCases.
Result<std::vector<CohortCase>> parse_cohort_table(
    std::string_view text, const std::string& source, const std::filesystem::path& folder,
    const std::function<bool(const std::string&)>& is_data_set = {});
/// With the catalogue's data sets.
Result<std::vector<CohortCase>> load_cohort_table(const std::filesystem::path& file);
inline constexpr std::size_t kMaxCases = 100'000;

// ---- a case ---------------------------------------------------------------------------------------------

inline constexpr double kNotThere = std::numeric_limits<double>::quiet_NaN();

/// The place of a structure where its two sides are nearest to each other.
struct ThinPlace {
  double thickness_mm = 0;
  Point<Patient> place;
};
/// Of a structure's middle, where the nearest voxels outside lie to either side (130 degrees apart or more),
/// the place where they are nearest, less a voxel: on a plate of n voxels n. Where a structure ends it tapers
/// off, so the middle counts only where it goes on to all sides, within kRim_mm. What stands out of a thicker
/// part by no more than a voxel is none of its own. The volume's border is no side. Nothing where there is no
/// such middle (a structure of a few voxels, one without an outside).
/// @param labels  flattened
std::optional<ThinPlace> thinnest_place(const Volume<LabelId>& labels, const SegmentStatistics& structure);
inline constexpr double kRim_mm = 3;

/// Squared distances, mm2, of every voxel of a box to the nearest voxel centre that is `outside`, and which
/// that is (Felzenszwalb, Huttenlocher 2012, separable). i fastest. -1: there is none.
struct NearestOutside {
  std::vector<float> squared_mm2;
  std::vector<std::int32_t> index;
};
NearestOutside nearest_outside(const std::array<int, 3>& dims, const Eigen::Vector3d& spacing_mm,
                               const std::vector<std::uint8_t>& outside);

struct StructureResult {
  std::string name;
  double volume_mm3 = 0;
  int components = 0;
  double thinnest_mm = kNotThere;
  std::size_t gaps = 0;  ///< places where a point may slip through (palpate/surfaces/surfaces.h, Leaks)
  bool felt = false;
  /// Where the script palpated it (HoldFigure), else not there.
  double held_s = kNotThere, mean_force_N = kNotThere, peak_force_N = kNotThere;
};

/// What came of a case. Without a time, a path or a text of its files but the names of structures.
struct CaseResult {
  std::string key;    ///< of all that it was made from (case_key)
  std::string fault;  ///< why there is no result, or none of the palpation; empty: all was done
  std::array<int, 3> dims{0, 0, 0};
  Eigen::Vector3d spacing_mm = Eigen::Vector3d::Zero();
  std::vector<StructureResult> structures;  ///< as in the model; none: it could not be read
  int palpated = 0, held = 0;  ///< structures that the script touches, and that were held for 0.1 s
  int failed_steps = 0;
  double largest_force_N = kNotThere;
  std::uint64_t ticks = 0, run_hash = 0;
  std::vector<std::string> notes;  ///< warnings, and steps that failed
};
/// s; apart from the results, which are the same on every machine.
struct CaseTimes {
  double read_s = 0, check_s = 0, palpate_s = 0, picture_s = 0;
};

/// A file that a case is made from.
struct CaseFile {
  std::string role;            ///< what it is read as, with its name: both change what is made of it
  std::filesystem::path file;  ///< empty: the cohort's table, which counts by being there
};
/// Every file that the row names, and that is read with them: those of a scene, tables of names beside labels
/// (every .ctbl and .tsv there: one alone is read, of several none), headers' data, whatever they are called.
std::vector<CaseFile> case_files(const CohortCase& one);

/// SHA-256, in hexadecimal, of the case's row, of the roles, names and bytes of case_files, and of the
/// program. Errors: a file that cannot be read; interrupted.
/// @param program  version and commit, and those of its options that change results
Result<std::string> case_key(const CohortCase& one, const std::string& program,
                             const Progress& progress = {});

/// Text without what names files: paths and names of the case's, of those that their headers and scenes name,
/// of what else stands in their folders, of the table's and the cohort's folder, as they are and as
/// printable_name() spells them; and whatever else has a '/' or a file's ending. Words that folders of
/// everybody are called by ("data"), and names that are wholly words of anatomy, stay.
std::string without_names(std::string text, const CohortCase& one, const std::filesystem::path& cohort = {});

std::string case_json(const CaseResult& result);
/// Believes nothing of the text. Nothing where it is no result.
std::optional<CaseResult> parse_case_json(std::string_view text);

/// Where the results of case number n, 1 the first, are.
std::filesystem::path case_folder(const std::filesystem::path& cohort, int number);
/// What stands there, where it is a result of this key.
std::optional<CaseResult> find_case(const std::filesystem::path& cohort, int number, const std::string& key);

struct CaseOptions {
  std::string program;     ///< as for case_key
  bool recording = false;  ///< keep run.h5
};
/// Reads, checks, palpates and draws a case, in this process, and writes result.json, times.json, picture.png
/// and perhaps run.h5 into its folder. A fault of the case is a result as well. Errors: kOutput,
/// kInterrupted.
Result<CaseResult> run_case(const CohortCase& one, int number, const std::filesystem::path& cohort,
                            const CaseOptions& options, const Progress& progress = {});
/// Where the process of a case has ended without a result: writes one that says so.
Result<void> write_fault(const CohortCase& one, int number, const std::filesystem::path& cohort,
                         const std::string& key, const std::string& fault);

// ---- engines --------------------------------------------------------------------------------------------

/// Runs a case's own process, and waits: what it says on stderr is kept.
struct EndedProcess {
  int exit_code = 0;  ///< -1 where a signal ended it
  int signal = 0;
  std::string said;  ///< the last 4 KiB of stderr
};
/// It ends where this process ends, and is asked to end (SIGTERM) when progress is stopped.
Result<EndedProcess> run_process(const std::vector<std::string>& command, const Progress& progress = {});

/// Starts `command` with the number of each case behind it, on this machine, some at a time, each in a
/// process group of its own; they end where this process ends. Interrupted it asks all of them to end, and
/// then waits.
/// @param jobs  at a time; 0: one for each processor
/// @param ended  called after each, with its number and how it ended
Result<void> run_locally(const std::vector<std::string>& command, const std::vector<int>& numbers, int jobs,
                         const std::function<void(int number, const EndedProcess& how)>& ended,
                         const Progress& progress = {});

struct SlurmOptions {
  int jobs = 0;                     ///< at a time; 0: as many as Slurm gives
  std::vector<std::string> sbatch;  ///< further options of sbatch: "--partition=long"
  std::filesystem::path folder;  ///< of the cohort; "slurm-job" in it names the job while it is not collected
  /// How long results are waited for that a node has written and this one does not see yet, s.
  double late_s = 60;
};
/// The same by one array job of Slurm, whose tasks have the cases' numbers, and waits for it. A job of an
/// earlier call that still runs for this folder is waited for first, and `numbers` are asked for anew.
/// Interrupted the job is cancelled; "slurm-job" stays unless it is gone then.
/// @param numbers  those that are not done, asked for when the job is submitted
/// @param look  called now and then; tells how many have no result yet
/// Errors: kUnavailable where Slurm is not there, does not answer or refuses the job, in its own words.
Result<void> run_by_slurm(const std::vector<std::string>& command,
                          const std::function<std::vector<int>()>& numbers, const SlurmOptions& options,
                          const std::function<std::size_t()>& look, const Progress& progress = {});
/// An error where a job of Slurm still works in the cohort's folder, or where Slurm cannot be asked whether
/// one that is noted there does. The note of one that is gone is removed.
Result<void> check_no_slurm_job(const std::filesystem::path& cohort);

// ---- what all of them show ------------------------------------------------------------------------------

struct CohortResults {
  std::vector<CohortCase> cases;
  std::vector<std::optional<CaseResult>> results;  ///< none: not done
};
/// A row a case, a column a figure, those of each structure behind; the same bytes for the same results.
std::string cohort_tsv(const CohortResults& cohort);
/// Seconds of each case, from its times.json.
std::string times_tsv(const CohortResults& cohort, const std::filesystem::path& folder);
/// The page that sorts and compares, with the cases' pictures in it.
std::string cohort_page(const CohortResults& cohort, const std::filesystem::path& folder,
                        const std::string& program);

}  // namespace palpate
