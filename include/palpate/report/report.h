#pragma once

#include <filesystem>
#include <string>

#include "palpate/base/progress.h"
#include "palpate/haptics/haptics.h"
#include "palpate/recording/recording.h"
#include "palpate/rehearsal/comparison.h"
#include "palpate/tasks/evaluator.h"

namespace palpate {

/// What was planned for a run, and what was made of it (compare_recording).
struct RehearsedPlan {
  const PlanInScene& plan;
  const PlanComparison& made;
};

/// What a run was scored by, and as (score_recording).
struct ScoredTask {
  const TaskFile& task;
  const TaskScore& score;
};
/// What a page tells of a run besides what is in its recording; each a part of its own, null: none.
struct ReportParts {
  const RehearsedPlan* rehearsed = nullptr;
  const ScoredTask* scored = nullptr;
  std::string names_from = {};  ///< where the labels have their names from, without a path; empty: not said
};

/// One self-contained HTML page about a run: sections through each contact, force, depth and speed over
/// time, contact per structure, what a burr took away, counts of the safety stage, how a loop on the real
/// clock kept time, where it came from. Read in memory that does not depend on the run's length, but for what
/// a burr took away. No network, no path and no header text of the input files in it.
/// @param model  as the recording began with; where a burr was at work with the proxy's surfaces (ready_for
/// in
///               palpate/palpation/palpation.h), without which the page says nothing of how deep it cut
Result<std::string> report_html(const RecordingSource& recording, const Model& model,
                                const Progress& progress = {}, const ReportParts& parts = {});
/// Written whole or not at all.
Result<void> write_report(const std::filesystem::path& file, const RecordingSource& recording,
                          const Model& model, const Progress& progress = {}, const ReportParts& parts = {});

}  // namespace palpate
