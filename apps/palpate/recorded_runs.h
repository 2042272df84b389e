#pragma once

#include <filesystem>
#include <string>

#include "palpate/records/records.h"
#include "scored.h"

namespace palpate::app {

/// What records keep of a score.
RunRecord record_of(const std::string& learner, const TaskFile& task, const ScoredRun& run);

/// Adds a run to the records, which are made where there are none. @return its number
Result<std::int64_t> record_run(const std::filesystem::path& file, const std::string& learner,
                                const TaskFile& task, const ScoredRun& run, Console& console);

}  // namespace palpate::app
