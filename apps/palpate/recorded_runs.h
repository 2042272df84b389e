#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "palpate/records/records.h"
#include "palpate/report/learners_page.h"
#include "palpate/session/training.h"
#include "scoring.h"

namespace palpate::app {

/// File of records: the requested one, or the default if `requested` is empty. Errors: kUsage without a
/// default.
Result<std::filesystem::path> records_file(const std::filesystem::path& requested);

/// Passes each selected run with its metrics to `visit`. @return number of runs
Result<std::size_t> each_run(Records& records, const RunFilter& filter,
                             const std::function<void(const RunRecord&)>& visit);

/// Page about a set of runs.
class LearnersPageBuilder {
 public:
  void visit(const RunRecord& run);
  std::string html();

 private:
  std::map<std::pair<std::string, std::string>, LearnersPage::Task> tasks_;  // by title and hash
};

/// Entry of the records for a scored run.
RunRecord record_of(const std::string& learner, const TaskFile& task, const ScoredRun& run);

/// Checks that runs of these learners can be added to a file of records, which is created if it does not
/// exist.
Result<void> check_records(const std::filesystem::path& file, const std::vector<std::string>& learners,
                           Console& console);

/// HTML page of the runs of a learner (empty: of all learners), as written by `palpate records page`.
Result<std::string> learners_page_html(const std::filesystem::path& file, const std::string& learner);

/// Adds a run to the records and returns the history of this learner's runs of the task, including this one.
Result<RunHistory> add_run_with_history(const std::filesystem::path& file, const std::string& learner,
                                        const TaskFile& task, const ScoredRun& run);

/// Adds a run to the records, which are created if they do not exist. @return number of the run
Result<std::int64_t> record_run(const std::filesystem::path& file, const std::string& learner,
                                const TaskFile& task, const ScoredRun& run, Console& console);

}  // namespace palpate::app
