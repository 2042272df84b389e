#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "palpate/json/json.h"
#include "palpate/loading/loading.h"
#include "palpate/session/training.h"
#include "palpate/tasks/evaluator.h"
#include "verb.h"

namespace palpate::app {

/// A scored run with the header of its recording.
struct ScoredRun {
  std::filesystem::path recording;
  RecordingHeader header;
  TaskScore score;
  std::uint64_t run_hash = 0;  ///< Hash of the recorded run; 0: the recording is incomplete
};

/// Scores recordings by a task, one after the other; the scene that they share is loaded once.
class Scorer {
 public:
  /// @param source  scene of recordings that name no data set; its target may be empty
  /// @param ticks   range of ticks of each recording to score
  Scorer(TaskFile task, SceneSource source, TickRange ticks = {})
      : task_(std::move(task)), source_(std::move(source)), ticks_(ticks) {}

  /// Scores a recording. Errors name the recording or the line of the task.
  Result<ScoredRun> score(const std::filesystem::path& recording, Console& console);
  const TaskFile& task() const { return task_; }

 private:
  TaskFile task_;
  SceneSource source_;
  TickRange ticks_;
  std::string loaded_;  // Data set of `model_`
  std::shared_ptr<const Model> model_;
  std::optional<TaskInScene> in_scene_;
};

/// Loads a task by its name in `palpate task list` or from a file, with the name under which viewers list
/// it.
Result<OfferedTask> offered_task(const std::string& name_or_file);

/// Task description to be stored in a recording. @param data_set  data set of the run
RecordedTask recorded_task(const OfferedTask& task, const std::string& data_set);
/// Task by which a recording is scored: the requested one, with a warning if the recording names another;
/// otherwise the one that the recording names. Errors: those of load_task; kUsage if the recording names no
/// task, or one that is not built in.
/// @param requested  value of --task; empty: not given
Result<OfferedTask> task_of_recording(const RecordingHeader& header, const std::string& requested,
                                      const std::filesystem::path& recording, Console& console);

/// Whether a recording is shown as a run of a task: if a task or a range of ticks is given, or if it names a
/// built-in task and consists of that run alone, as with a simulated hand. A person starts a run in the
/// middle of a session, so that recording is not shown as a run by default.
/// @param requested  value of --task; empty: not given
bool is_run_of_task(const RecordingHeader& header, const std::string& requested, const TickRange& ticks);

/// Resolves a task in the model with which a recording began. The surfaces are computed if the task has
/// patches on them.
Result<TaskInScene> resolve_for_score(const TaskFile& task, std::shared_ptr<const Model> model,
                                      const Progress& progress);

/// Adds --from-tick and --to-tick.
void add_tick_options(CLI::App& verb, TickRange& ticks);
/// Error for a --from-tick after --to-tick.
Error ticks_in_reverse();

/// JSON number; null for an unknown value.
Json number_or_null(double value);
Json number_or_null(const std::optional<double>& value);

/// Prints a score as text. @param name  name of the run
void print_score(const TaskFile& task, const TaskScore& score, const std::string& name);

/// JSON of a score, as written by `palpate task score --json`.
Json json_of(const TaskFile& task, const ScoredRun& run);

}  // namespace palpate::app
