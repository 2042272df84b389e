#pragma once

#include <filesystem>
#include <string>

#include "palpate/records/records.h"
#include "palpate/session/training.h"
#include "scored.h"

namespace palpate::app {

/// What records keep of a score.
RunRecord record_of(const std::string& learner, const TaskFile& task, const ScoredRun& run);

/// Whether records can be kept there, which are made where there are none.
Result<void> check_records(const std::filesystem::path& file, const std::string& learner, Console& console);

/// Adds a run to the records, and tells what there is of the learner's runs of this task, it included.
Result<RunHistory> keep_run(const std::filesystem::path& file, const std::string& learner,
                            const TaskFile& task, const ScoredRun& run);

/// Adds a run to the records, which are made where there are none. @return its number
Result<std::int64_t> record_run(const std::filesystem::path& file, const std::string& learner,
                                const TaskFile& task, const ScoredRun& run, Console& console);

}  // namespace palpate::app
