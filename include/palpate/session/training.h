#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "palpate/recording/recording.h"
#include "palpate/scene/task_file.h"
#include "palpate/tasks/evaluator.h"

/// Tasks in a live session.
///
///    servo ── ticks, ring ──► recorder's thread ──► file
///                                    └──► evaluator ── progress ──► viewers
///                                             └─ run over ─► separate thread: records, debriefing
///
/// The evaluator processes the same ticks as the recorder, in order and on the same thread: a run's figures
/// equal those computed from its recording, bit for bit. A tick for which the ring had no room is missing in
/// both, and such a run does not pass.
namespace palpate {

/// Task that can be started, under the name by which viewers request it; never the name of a user's file.
struct OfferedTask {
  std::string name;
  TaskFile file;
};

/// Reason for the end of a run.
enum class RunEnd : std::uint8_t {
  kTask,       ///< All steps were done, or the time limit expired
  kRequested,  ///< Requested by a viewer or a key
  kSession,    ///< The session ended
  kFailure,    ///< The clock ran backwards, or memory ran out: the run does not pass
};

/// Finished run.
struct TaskRun {
  std::string task;          ///< OfferedTask::name
  std::uint32_t number = 0;  ///< Number within the session, from 1
  RunEnd end = RunEnd::kTask;
  std::string learner;  ///< Pseudonym of the learner; empty: none
  TaskScore score;
  TickRange ticks;             ///< First and last tick of the run, as passed to `palpate task score`
  std::uint64_t run_hash = 0;  ///< Hash over these ticks, computed as RecordingSummary::run_hash is over all
  std::shared_ptr<const RecordingHeader> header;  ///< Header of the session's recording
};
/// Maximum number of runs in a session.
inline constexpr std::uint32_t kMaxRunsOfSession = 1000;

/// A learner's record for one task, including this run.
struct RunHistory {
  int runs = 0, in_a_row = 0;
  /// Best value of each metric over the earlier runs that were in band; an aborted run would otherwise be
  /// best in path length and force. kNoValue if there is none.
  std::vector<double> best;
  std::optional<std::int64_t> run_id;  ///< Number of this run in the records
  std::optional<Error> not_stored;
};

/// Finished run with the learner's history.
struct FinishedRun {
  TaskRun run;
  RunHistory history;
};

/// History of the last of `runs`, all of which are runs of `task`.
RunHistory history_of(const TaskFile& task, const std::vector<TaskRun>& runs);

/// Tasks of a session, and storage of their runs.
struct TrainingOptions {
  std::vector<OfferedTask> tasks;
  /// Whether a task whose structures the scene lacks is an error; else it is omitted
  bool requires_all_tasks = false;
  bool begins_with_first_tick = false;  ///< Whether the first task begins with the first tick
  std::string learner;                  ///< Pseudonym of the initial learner; empty: none
  /// Stores a learner's finished run and returns the history from the records. Called on a separate thread,
  /// for one run at a time; may take long. Empty: runs are not stored. The history of a run that is not
  /// stored covers the session's own runs.
  std::function<RunHistory(const TaskFile& task, const TaskRun& run)> store_run;
  /// Implements LiveHost::curves from the stored runs; empty: not available.
  std::function<Result<std::string>(const std::string& learner)> curves;
};

}  // namespace palpate
