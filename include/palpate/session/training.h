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

/// Tasks that are done in a live session.
///
///     servo ── ticks, ring ──► recorder's thread ──► file
///                                     └──► evaluator ── how far it is ──► viewers
///                                              └─ over ─► a thread of its own: records, debriefing
///
/// The evaluator reads what the recorder reads, tick by tick in order, on the same thread: a run's figures
/// are those of its recording, bit for bit. A tick that the ring had no room for is missing in both, and such
/// a run does not pass.
namespace palpate {

/// A task that may be begun, by the name by which viewers ask for it: never that of a user's file.
struct OfferedTask {
  std::string name;
  TaskFile file;
};

enum class RunEnd : std::uint8_t {
  kTask,     ///< its steps were done, or its time was up
  kAsked,    ///< by a viewer or a key
  kSession,  ///< the session was over
  kTrouble,  ///< the clock went back, or there was no memory: it does not pass
};

/// A run that is over.
struct TaskRun {
  std::string task;          ///< OfferedTask::name
  std::uint32_t number = 0;  ///< in this session, from 1
  RunEnd end = RunEnd::kTask;
  std::string learner;  ///< whose it is, a pseudonym; empty: nobody's
  TaskScore score;
  TickRange ticks;             ///< its first and its last, which `palpate task score` is to be told
  std::uint64_t run_hash = 0;  ///< over these, as RecordingSummary::run_hash over all
  std::shared_ptr<const RecordingHeader> header;  ///< of the session
};
/// A session has so many runs at most.
inline constexpr std::uint32_t kMostRunsOfSession = 1000;

/// What is known of a learner's runs of a task, this one included.
struct RunHistory {
  int runs = 0, in_a_row = 0;
  /// Of the task's metrics, in the runs before this one that were in band: one that was broken off has a
  /// short way and little force. kNotKnown where there is none.
  std::vector<double> best;
  std::optional<std::int64_t> kept;  ///< number in the records
  std::optional<Error> not_kept;
};

struct FinishedRun {
  TaskRun run;
  RunHistory history;
};

/// The history of the last of some runs of one task.
RunHistory history_of(const TaskFile& task, const std::vector<TaskRun>& runs);

struct TrainingOptions {
  std::vector<OfferedTask> tasks;
  bool have_to_fit = false;  ///< a task that the scene has no structures for is an error; else it is left out
  bool begins_at_once = false;  ///< the first task begins with the first tick
  std::string learner;          ///< whose runs they are at first, a pseudonym; empty: nobody's
  /// Keeps a learner's run that is over, and tells what there is of those before it. On a thread of its own,
  /// one run after the other; may take long. Empty: nothing is kept. Of what is not kept the session's own
  /// runs are the history.
  std::function<RunHistory(const TaskFile& task, const TaskRun& run)> over;
  /// ViewerHost::curves, of what is kept; empty: there are none.
  std::function<Result<std::string>(const std::string& learner)> curves;
};

}  // namespace palpate
