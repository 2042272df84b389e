#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/base/result.h"

/// Records of learners: runs with their scores in one SQLite file. Learners are identified by pseudonyms; no
/// file of palpate stores their identity. docs/guide/records.md describes the tables.
namespace palpate {

/// Value of a metric in a run.
struct RunMetric {
  std::string name;  ///< metric_name() (palpate/tasks/evaluator.h); for readers: readable_metric_name()
  std::string unit;
  std::optional<double> value;  ///< Value; finite. Empty: not available in this run
  std::optional<double> at_least, at_most;
  bool counts = false, in_band = false;

  friend bool operator==(const RunMetric&, const RunMetric&) = default;
};

/// A scored run of a learner.
struct RunRecord {
  std::int64_t id = 0;  ///< Assigned by add(); increasing
  std::string learner;
  std::string task, task_hash;
  std::string started_utc;  ///< First tick of the run, ISO 8601
  std::string data_set;
  std::string palpate_version, commit;
  std::string device, hand;   ///< Simulated device and hand of the recording; empty: a real one
  std::string settings_hash;  ///< Hash of the settings that affect the haptic rendering
  std::string run_hash, score_hash;
  double duration_s = 0;
  int in_a_row = 1;  ///< Consecutive passes required by the task
  bool in_band = false;
  std::vector<RunMetric> metrics;  ///< Not read by list()
};

/// Query; empty or 0: no restriction.
struct RunFilter {
  std::string learner, task;
  std::int64_t newest = 0;  ///< Maximum number of runs, the newest ones
};

/// Result of erase(): number of runs deleted, and whether the learner existed.
struct Erased {
  std::int64_t runs = 0;
  bool was_known = false;
};

/// An open file of records.
class Records {
 public:
  /// Opens the file, creating it if necessary. Errors: kBadInput for another kind of file or a newer format;
  /// kOutput if it is not writable; kUnavailable if another program locks it for longer than 5 s.
  static Result<std::unique_ptr<Records>> open(const std::filesystem::path& file);
  /// Opens the file read-only; a missing file is an error.
  static Result<std::unique_ptr<Records>> open_to_read(const std::filesystem::path& file);
  virtual ~Records() = default;

  /// Adds a run atomically; it is on disk when the function returns. Adding the same run of the same learner,
  /// scored by the same task, again returns the existing id. Errors: those of check_learner
  /// (palpate/base/learner.h), kOutput.
  virtual Result<std::int64_t> add(const RunRecord& run) = 0;
  /// Lists runs in the order of their ids. `visit` may stop it by returning an error.
  virtual Result<void> list(const RunFilter& filter,
                            const std::function<Result<void>(const RunRecord&)>& visit) = 0;
  /// Reads a run with its metrics. Error kBadInput if there is none.
  virtual Result<RunRecord> run(std::int64_t id) = 0;
  /// Deletes a learner with all runs, so that neither the file, its log nor free pages contain any byte of
  /// them. Copies of the file and remnants in the file system are out of its control. Errors: kUnavailable
  /// while another program has the file open: the rows are deleted, but traces may remain until the function
  /// is called again.
  virtual Result<Erased> erase(const std::string& learner) = 0;
};

/// Whether the text resembles a person's name rather than a pseudonym: "Doe^Jane", "Jane Doe",
/// "jane@example.org".
bool resembles_personal_name(const std::string& learner);

/// PALPATE_RECORDS, otherwise palpate/records.db below XDG_DATA_HOME or ~/.local/share. Empty if none of
/// these is set.
std::filesystem::path default_records_file();

/// CSV (RFC 4180) with a heading and one line per metric of each run. A text that a spreadsheet would
/// interpret as a formula is prefixed with an apostrophe.
std::string csv_heading();
std::string csv_rows(const RunRecord& run);
/// Name for readers of a metric by its stored name, such as readable_metric_name()
/// (palpate/scene/task_file.h).
using MetricTitle = std::function<std::string(std::string_view stored)>;
/// An xAPI 1.0.3 statement on one line. The same run gives the same id.
/// @param home_page  IRL of the system that assigns the learners' pseudonyms
/// @param title_of   names of the metrics in the statement
std::string xapi_statement(const RunRecord& run, const std::string& home_page, const MetricTitle& title_of);
/// ISO 8601 duration: "PT12.5S"
std::string iso_duration(double seconds);

}  // namespace palpate
