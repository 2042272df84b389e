#include <algorithm>
#include <chrono>
#include <functional>
#include <optional>
#include <thread>

#include "cohort/process.h"
#include "palpate/base/file.h"
#include "palpate/base/for_each_index.h"
#include "palpate/base/printable.h"
#include "palpate/cohort/engines.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

std::vector<std::string> with_number(std::vector<std::string> command, int number) {
  command.push_back(std::to_string(number));
  return command;
}

// ---- Slurm ----------------------------------------------------------------------------------------------

/// Quotes a word for the shell.
std::string quoted(const std::string& word) {
  std::string text = "'";
  for (const char c : word) {
    if (c == '\'')
      text += "'\\''";
    else
      text += c;
  }
  return text + "'";
}

/// Array specification of sorted numbers: 1, 2, 3, 7 as "1-3,7".
std::string array_of(const std::vector<int>& numbers) {
  std::string text;
  for (std::size_t n = 0; n < numbers.size();) {
    std::size_t last = n;
    while (last + 1 < numbers.size() && numbers[last + 1] == numbers[last] + 1) ++last;
    text += (text.empty() ? "" : ",") + std::to_string(numbers[n]);
    if (last > n) text += "-" + std::to_string(numbers[last]);
    n = last + 1;
  }
  return text;
}

std::string first_line(const std::string& text) {
  return printable_name(text.substr(0, text.find('\n')));
}

constexpr const char* kNotFound = " was not found";
Error without_slurm(const std::string& program) {
  return {ErrorKind::kUnavailable, "Slurm's " + program + kNotFound, program,
          "run on a machine with Slurm's commands (Debian: slurm-client), or use --engine local"};
}

/// Whether any task of the job is pending, running or completing.
Result<bool> is_alive(const std::string& job) {
  const auto output = cohort::run_command({"squeue", "--noheader", "--format=%T", "--jobs=" + job});
  if (!output) return output.error();
  if (output->exit_code == 127) return without_slurm("squeue");
  if (output->exit_code == 0) return output->out.find_first_not_of(" \n") != std::string::npos;
  // the job is no longer in Slurm's records
  if (output->err.find("Invalid job id") != std::string::npos) return false;
  return Error{ErrorKind::kUnavailable, "Slurm does not answer: " + first_line(output->err), "squeue",
               "the job still exists: run the same command again once Slurm answers to collect it"};
}

struct Waited {
  Result<void> how;
  bool gone = false;  ///< Whether Slurm reports that the job is gone
};

/// Cancels a job; returns whether Slurm confirmed that nothing of it is left.
bool cancel(const std::string& job) {
  const auto output = cohort::run_command({"scancel", job});
  if (!output || output->exit_code != 0) return false;
  constexpr int kTries = 60;
  for (int tries = 0; tries < kTries; ++tries) {
    const auto alive = is_alive(job);
    if (alive && !*alive) return true;
    std::this_thread::sleep_for(500ms);
  }
  return false;
}

Waited wait_for(const std::string& job, const std::function<std::size_t()>& count_missing,
                const Progress& progress) {
  int silent = 0;
  while (true) {
    const auto alive = is_alive(job);
    // tolerates a restart of the controller
    constexpr int kTries = 60;
    if (!alive && (++silent >= kTries || alive.error().where != "squeue" ||
                   alive.error().what.find(kNotFound) != std::string::npos))
      return {alive.error(), false};
    if (alive) silent = 0;
    count_missing();
    if (alive && !*alive) return {{}, true};
    for (int n = 0; n < 10; ++n) {
      if (progress.stopped()) return {Progress::interrupted(), cancel(job)};
      std::this_thread::sleep_for(100ms);
    }
  }
}

/// Job id stored in a cohort's folder.
std::optional<std::string> noted_job(const fs::path& note) {
  const auto text = read_file(note, 64);
  if (!text) return std::nullopt;
  std::string job = text->substr(0, text->find('\n'));
  if (job.empty() || job.find_first_not_of("0123456789") != job.npos) return std::nullopt;
  return job;
}

}  // namespace

Result<void> check_no_slurm_job(const fs::path& cohort) {
  const fs::path note = cohort / "slurm-job";
  const auto job = noted_job(note);
  if (!job) return {};
  const auto alive = is_alive(*job);
  if (alive && !*alive) {
    std::error_code none;
    fs::remove(note, none);
    return {};
  }
  return Error{ErrorKind::kUnavailable,
               alive ? "Slurm's job " + *job + " is still running in this folder"
                     : "is in use by Slurm's job " + *job + ", and " + alive.error().what,
               cohort.string(),
               "collect it with --engine slurm, or end it (scancel " + *job +
                   "); if it no longer exists, remove " + note.string()};
}

Result<void> run_locally(const std::vector<std::string>& command, const std::vector<int>& numbers, int jobs,
                         const std::function<void(int number, const EndedProcess& how)>& ended,
                         const Progress& progress) {
  struct Running {
    pid_t id;
    int number;
    cohort::MemoryFile error_output;
  };
  const auto max_running = static_cast<std::size_t>(jobs > 0 ? jobs : processors());
  std::vector<Running> running;
  const auto end_all = [&] {
    std::vector<pid_t> ids;
    for (const Running& one : running) ids.push_back(one.id);
    cohort::end_groups(std::move(ids));
  };
  std::size_t next = 0;
  while (next < numbers.size() || !running.empty()) {
    if (progress.stopped()) {
      end_all();
      return Progress::interrupted();
    }
    while (running.size() < max_running && next < numbers.size()) {
      cohort::MemoryFile error_output;
      const auto id = cohort::start(with_number(command, numbers[next]), -1, -1, error_output.descriptor());
      if (!id) {
        end_all();
        return id.error();
      }
      running.push_back({*id, numbers[next++], std::move(error_output)});
    }
    std::vector<std::pair<int, EndedProcess>> done;
    std::erase_if(running, [&](const Running& one) {
      cohort::ExitStatus how;
      if (!cohort::has_ended(one.id, how)) return false;
      done.push_back(
          {one.number, {how.exit_code, how.signal, one.error_output.tail(cohort::kRetainedOutput)}});
      return true;
    });
    for (const auto& [number, how] : done) ended(number, how);
    if (done.empty()) std::this_thread::sleep_for(10ms);
  }
  return {};
}

Result<void> run_by_slurm(const std::vector<std::string>& command,
                          const std::function<std::vector<int>()>& numbers, const SlurmOptions& options,
                          const std::function<std::size_t()>& count_missing, const Progress& progress) {
  const fs::path note = options.folder / "slurm-job";
  std::error_code none;
  if (const auto earlier = noted_job(note)) {
    const Waited waited = wait_for(*earlier, count_missing, progress);
    if (waited.gone) fs::remove(note, none);
    if (!waited.how) return waited.how;
  }
  const std::vector<int> unfinished = numbers();
  if (unfinished.empty()) return {};

  std::string script = "#!/bin/sh\nexec";
  for (const std::string& word : command) script += " " + quoted(word);
  script += " \"$SLURM_ARRAY_TASK_ID\"\n";
  std::vector<std::string> submit{
      "sbatch", "--parsable", "--job-name=palpate-cohort", "--output=/dev/null",
      "--array=" + array_of(unfinished) + (options.jobs > 0 ? "%" + std::to_string(options.jobs) : "")};
  submit.insert(submit.end(), options.sbatch.begin(), options.sbatch.end());
  const auto output = cohort::run_command(submit, script);
  if (!output) return output.error();
  if (output->exit_code == 127) return without_slurm("sbatch");
  // "12", or "12;cluster"
  const std::string job = output->out.substr(0, output->out.find_first_of(";\n"));
  if (output->exit_code != 0 || job.empty() || job.find_first_not_of("0123456789") != job.npos)
    return Error{ErrorKind::kUnavailable, "Slurm refuses the job: " + first_line(output->err), "sbatch",
                 "--sbatch passes further options to sbatch, such as --sbatch=--partition=NAME"};
  if (auto written = write_file(note, job + "\n"); !written) {
    (void)cohort::run_command({"scancel", job}).ok();
    return written;
  }
  const Waited waited = wait_for(job, count_missing, progress);
  // the file of a job that may still be running is kept
  if (waited.gone) fs::remove(note, none);
  if (!waited.how) return waited.how;
  // results written by other machines become visible once the file system refreshes its cached directory
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(options.late_s);
  while (count_missing() > 0 && std::chrono::steady_clock::now() < end) {
    if (progress.stopped()) return Progress::interrupted();
    std::this_thread::sleep_for(500ms);
  }
  return {};
}

}  // namespace palpate
