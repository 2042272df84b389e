#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "palpate/base/result.h"

/// What learners did: runs and their scores in one SQLite file. A learner is a pseudonym; who it is, no file
/// of palpate's says. docs/guide/records.md draws the tables.
namespace palpate {

struct RunMetric {
  std::string name, unit;
  std::optional<double> value;  ///< finite; empty: the run had none
  std::optional<double> at_least, at_most;
  bool counts = false, in_band = false;

  friend bool operator==(const RunMetric&, const RunMetric&) = default;
};

struct RunRecord {
  std::int64_t id = 0;  ///< given by add(); grows from run to run
  std::string learner;
  std::string task, task_hash;
  std::string started_utc;  ///< ISO 8601, of the recording
  std::string data_set;
  std::string palpate_version, commit;
  std::string device, hand;   ///< of the recording; empty: a real one
  std::string settings_hash;  ///< of what decided how it felt
  std::string run_hash, score_hash;
  double duration_s = 0;
  int in_a_row = 1;  ///< that the task asks for
  bool in_band = false;
  std::vector<RunMetric> metrics;  ///< not read by list()
};

/// What is asked for; empty or 0: all.
struct RunFilter {
  std::string learner, task;
  std::int64_t newest = 0;  ///< so many at most, the newest
};

struct Erased {
  std::int64_t runs = 0;
  bool was_known = false;
};

class Records {
 public:
  /// Makes the file where there is none. Errors: kBadInput for what is no such file, or of a newer format;
  /// kOutput where it cannot be written; kUnavailable where another program keeps it longer than 5 s.
  static Result<std::unique_ptr<Records>> open(const std::filesystem::path& file);
  /// To read alone; a file that is not there is an error.
  static Result<std::unique_ptr<Records>> open_to_read(const std::filesystem::path& file);
  virtual ~Records() = default;

  /// In the file, and on the disk, before it returns; whole or not at all. The same run of the same learner
  /// scored by the same task again is there once: its id. Errors: those of check_learner
  /// (palpate/base/learner.h), kOutput.
  virtual Result<std::int64_t> add(const RunRecord& run) = 0;
  /// In the order of their ids. `take` may end it by an error.
  virtual Result<void> list(const RunFilter& filter,
                            const std::function<Result<void>(const RunRecord&)>& take) = 0;
  /// With its metrics. Error kBadInput where there is none.
  virtual Result<RunRecord> run(std::int64_t id) = 0;
  /// Removes a learner with all runs, so that neither the file nor its log nor free pages hold a byte of
  /// them. What the file system or copies of the file hold is beyond it. Errors: kUnavailable while another
  /// program has the file open: then the rows are gone, and traces may be left until this is called again.
  virtual Result<Erased> erase(const std::string& learner) = 0;
};

/// Whether it looks like somebody's name rather than a pseudonym: "Doe^Jane", "Jane Doe", "jane@example.org".
bool looks_like_a_person(const std::string& learner);

/// PALPATE_RECORDS, else records.db below palpate/ in XDG_DATA_HOME or ~/.local/share. Empty where none of
/// these is set.
std::filesystem::path default_records_file();

/// A line for each metric of each run, with a heading (RFC 4180). A text that a spreadsheet would take for a
/// formula is preceded by an apostrophe.
std::string csv_heading();
std::string csv_rows(const RunRecord& run);
/// An xAPI 1.0.3 statement, in one line. The same run gives the same id.
/// @param home_page  IRL of the system that gives out the learners' pseudonyms
std::string xapi_statement(const RunRecord& run, const std::string& home_page);
/// "PT12.5S"
std::string iso_duration(double seconds);

}  // namespace palpate
