#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "palpate/records/records.h"
#include "palpate/session/training.h"
#include "scored.h"

namespace palpate::app {

/// What records keep of a score.
RunRecord record_of(const std::string& learner, const TaskFile& task, const ScoredRun& run);

/// Whether records of these learners can be kept there, which are made where there are none.
Result<void> check_records(const std::filesystem::path& file, const std::vector<std::string>& learners,
                           Console& console);

/// The page of a learner's runs, or of everybody's (empty), as `palpate records page` writes it.
Result<std::string> curves_of(const std::filesystem::path& file, const std::string& learner);

/// Adds a run to the records, and tells what there is of the learner's runs of this task, it included.
Result<RunHistory> keep_run(const std::filesystem::path& file, const std::string& learner,
                            const TaskFile& task, const ScoredRun& run);

/// Adds a run to the records, which are made where there are none. @return its number
Result<std::int64_t> record_run(const std::filesystem::path& file, const std::string& learner,
                                const TaskFile& task, const ScoredRun& run, Console& console);

}  // namespace palpate::app
