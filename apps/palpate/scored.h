#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "palpate/json/json.h"
#include "palpate/session/training.h"
#include "palpate/tasks/evaluator.h"
#include "verb.h"

namespace palpate::app {

/// A run with the header of its recording.
struct ScoredRun {
  std::filesystem::path recording;
  RecordingHeader header;
  TaskScore score;
  std::uint64_t run_hash = 0;  ///< of the recording; 0: it was cut short
};

/// Scores recordings by a task, one after the other; what they share is loaded once.
class Scorer {
 public:
  /// @param source  scene of recordings that name no data set; its target may be empty
  /// @param ticks   of each recording that are scored
  Scorer(TaskFile task, SceneSource source, TickRange ticks = {})
      : task_(std::move(task)), source_(std::move(source)), ticks_(ticks) {}

  /// Errors name the recording or the task's line.
  Result<ScoredRun> score(const std::filesystem::path& recording, Console& console);
  const TaskFile& task() const { return task_; }

 private:
  TaskFile task_;
  SceneSource source_;
  TickRange ticks_;
  std::string loaded_;  // data set
  std::shared_ptr<const Model> model_;
  std::optional<TaskInScene> in_scene_;
};

/// A task of palpate task list, or a file, by the name that viewers know it by.
Result<OfferedTask> offered_task(const std::string& name_or_file);

/// What a recording is to say of its task. @param data_set  in which it is done
RecordedTask recorded_task(const OfferedTask& task, const std::string& data_set);
/// The task that a recording is looked at by: the one that is asked for, of which a recording that says
/// another is told; else the one that the recording says. Errors: those of load_task, kUsage where the
/// recording says none, or one of a file of the user's.
/// @param asked  --task, empty: nobody asked for one
Result<OfferedTask> task_of_recording(const RecordingHeader& header, const std::string& asked,
                                      const std::filesystem::path& recording, Console& console);

/// Whether a recording is shown as a run of a task without being asked: where it says one that palpate brings
/// along and all of it is that run, as by a simulated hand, or ticks are given. A person begins a run in the
/// middle. @param asked  --task; where it is given it is
bool is_run_of_task(const RecordingHeader& header, const std::string& asked, const TickRange& ticks);

/// A task in the model that a recording began with, whose surfaces are made where patches lie on them.
Result<TaskInScene> look_up_for_score(const TaskFile& task, std::shared_ptr<const Model> model,
                                      const Progress& progress);

/// --from-tick and --to-tick.
void add_tick_options(CLI::App& verb, TickRange& ticks);
/// The one that --from-tick after --to-tick is.
Error ticks_in_reverse();

/// What is not known is null.
Json number_or_null(double value);
Json number_or_null(const std::optional<double>& value);

/// A score in text. @param name  of the run
void print_score(const TaskFile& task, const TaskScore& score, const std::string& name);

/// A score as `palpate task score --json` writes it.
Json json_of(const TaskFile& task, const ScoredRun& run);

}  // namespace palpate::app
