#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"

namespace palpate {

/// Exit status and error output of a case's process.
struct EndedProcess {
  int exit_code = 0;  ///< -1 if terminated by a signal
  int signal = 0;
  std::string error_output;  ///< Last 4 KiB of stderr
};
/// Runs a process and waits for it. It is killed when this process ends, and receives SIGTERM when progress
/// is stopped.
Result<EndedProcess> run_process(const std::vector<std::string>& command, const Progress& progress = {});

/// Runs `command` with the number of each case appended, several at a time on this machine, each in its own
/// process group; they are killed when this process ends. On interruption all receive SIGTERM and are waited
/// for.
/// @param jobs   maximum number at a time; 0: number of processors
/// @param ended  called after each process with its number and exit status
Result<void> run_locally(const std::vector<std::string>& command, const std::vector<int>& numbers, int jobs,
                         const std::function<void(int number, const EndedProcess& how)>& ended,
                         const Progress& progress = {});

struct SlurmOptions {
  int jobs = 0;                     ///< Maximum number of tasks at a time; 0: decided by Slurm
  std::vector<std::string> sbatch;  ///< Additional options of sbatch: "--partition=long"
  /// Folder of the cohort; its file "slurm-job" holds the id of a job that has not been collected
  std::filesystem::path folder;
  /// Maximum time, s, to wait for results that a node has written and that are not yet visible on this
  /// machine.
  double late_s = 60;
};
/// Runs the cases as one array job of Slurm, with the case numbers as task ids, and waits for it. If a job of
/// an earlier call is still running for this folder it is awaited first, and `numbers` is evaluated
/// afterwards. On interruption the job is cancelled; "slurm-job" remains unless the job is gone by then.
/// @param numbers        cases that are not done; called when the job is submitted
/// @param count_missing  called periodically; returns the number of cases without a result
/// Errors: kUnavailable, with Slurm's message, if Slurm is missing, does not respond or rejects the job.
Result<void> run_by_slurm(const std::vector<std::string>& command,
                          const std::function<std::vector<int>()>& numbers, const SlurmOptions& options,
                          const std::function<std::size_t()>& count_missing, const Progress& progress = {});
/// Error if a Slurm job is still running in the cohort's folder, or if its state cannot be determined. The
/// job file of a finished job is removed.
Result<void> check_no_slurm_job(const std::filesystem::path& cohort);

}  // namespace palpate
