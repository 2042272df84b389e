#pragma once

#include <filesystem>
#include <string>

#include "palpate/base/progress.h"
#include "palpate/contact/model.h"
#include "palpate/recording/recording_source.h"
#include "palpate/rehearsal/comparison.h"
#include "palpate/tasks/evaluator.h"

namespace palpate {

/// A plan and its comparison with the run (compare_recording).
struct RehearsedPlan {
  const PlanInScene& plan;
  const PlanComparison& comparison;
};

/// A task and the score of the run (score_recording).
struct ScoredTask {
  const TaskFile& task;
  const TaskScore& score;
};
/// Optional parts of a report that are not in the recording. null: the part is omitted.
struct ReportParts {
  const RehearsedPlan* rehearsed = nullptr;
  const ScoredTask* scored = nullptr;
  std::string names_from = {};  ///< Origin of the label names, without a path; empty: omitted
};

/// Report of a run as one self-contained HTML page: sections through each contact; force, depth and speed
/// over time; contacts per structure; tissue removed by a burr; counts of the safety stage; timing of a loop
/// on the real clock; provenance. Memory does not depend on the run's length, except for the removed tissue.
/// The page contains no paths and no header text of the input files, and needs no network.
/// @param model  model at the start of the recording. If a burr was used, it needs the surfaces of the proxy
///               (prepared_with_cache in palpate/loading/loading.h); without them the cutting depth is
///               omitted
Result<std::string> report_html(const RecordingSource& recording, const Model& model,
                                const Progress& progress = {}, const ReportParts& parts = {});
/// Writes the report atomically.
Result<void> write_report(const std::filesystem::path& file, const RecordingSource& recording,
                          const Model& model, const Progress& progress = {}, const ReportParts& parts = {});

}  // namespace palpate
