#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "palpate/records/records.h"
#include "palpate/session/training.h"
#include "scoring.h"

namespace palpate::app {

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
