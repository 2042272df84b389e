#include <algorithm>
#include <chrono>
#include <functional>
#include <thread>

#include "cohort/process.h"
#include "palpate/base/file.h"
#include "palpate/base/for_each_index.h"
#include "palpate/base/printable.h"
#include "palpate/cohort/cohort.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

std::vector<std::string> with_number(std::vector<std::string> command, int number) {
  command.push_back(std::to_string(number));
  return command;
}

// ---- Slurm ----------------------------------------------------------------------------------------------

/// A word as a shell reads it as one.
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

/// 1, 2, 3, 7 as "1-3,7"
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

Error without_slurm(const std::string& program) {
  return {ErrorKind::kUnavailable, "Slurm's " + program + " is not to be found", program,
          "run where Slurm's commands are (Debian: slurm-client), or use --engine local"};
}

/// Whether something of the job is still waiting, running or ending.
Result<bool> is_alive(const std::string& job) {
  const auto said = cohort::ask({"squeue", "--noheader", "--format=%T", "--jobs=" + job});
  if (!said) return said.error();
  if (said->exit_code == 127) return without_slurm("squeue");
  if (said->exit_code == 0) return said->out.find_first_not_of(" \n") != std::string::npos;
  // of a job that it has forgotten
  if (said->err.find("Invalid job id") != std::string::npos) return false;
  return Error{ErrorKind::kUnavailable, "Slurm does not answer: " + first_line(said->err), "squeue",
               "the job is still there: run the same command again once Slurm answers, and it is collected"};
}

Result<void> wait_for(const std::string& job, const std::function<void()>& look, const Progress& progress) {
  int silent = 0;
  while (true) {
    const auto alive = is_alive(job);
    // a controller that is restarted answers again
    constexpr int kTries = 60;
    if (!alive && (++silent >= kTries || alive.error().where != "squeue" ||
                   alive.error().what.find("not to be found") != std::string::npos))
      return alive.error();
    if (alive) silent = 0;
    look();
    if (alive && !*alive) return {};
    for (int n = 0; n < 10; ++n) {
      if (progress.stopped()) {
        (void)cohort::ask({"scancel", job}).ok();
        return Progress::interrupted();
      }
      std::this_thread::sleep_for(100ms);
    }
  }
}

}  // namespace

Result<void> run_locally(const std::vector<std::string>& command, const std::vector<int>& numbers, int jobs,
                         const std::function<void(int number)>& ended, const Progress& progress) {
  struct Running {
    pid_t id;
    int number;
  };
  const auto most = static_cast<std::size_t>(jobs > 0 ? jobs : processors());
  std::vector<Running> running;
  std::size_t next = 0;
  while (next < numbers.size() || !running.empty()) {
    if (progress.stopped()) {
      for (const Running& one : running) cohort::end_group(one.id);
      return Progress::interrupted();
    }
    while (running.size() < most && next < numbers.size()) {
      const auto id = cohort::start(with_number(command, numbers[next]), -1, -1, -1);
      if (!id) {
        for (const Running& one : running) cohort::end_group(one.id);
        return id.error();
      }
      running.push_back({*id, numbers[next++]});
    }
    std::vector<int> done;
    std::erase_if(running, [&](const Running& one) {
      cohort::Ended how;
      if (!cohort::has_ended(one.id, how)) return false;
      done.push_back(one.number);
      return true;
    });
    for (const int number : done) ended(number);
    if (done.empty()) std::this_thread::sleep_for(10ms);
  }
  return {};
}

Result<void> run_by_slurm(const std::vector<std::string>& command,
                          const std::function<std::vector<int>()>& numbers, const SlurmOptions& options,
                          const std::function<void()>& look, const Progress& progress) {
  const fs::path note = options.folder / "slurm-job";
  std::error_code none;
  if (const auto earlier = read_file(note, 64)) {
    const std::string job = earlier->substr(0, earlier->find('\n'));
    const bool is_number = !job.empty() && job.find_first_not_of("0123456789") == job.npos;
    if (is_number)
      if (auto waited = wait_for(job, look, progress); !waited) return waited;
    fs::remove(note, none);
  }
  const std::vector<int> left = numbers();
  if (left.empty()) return {};

  std::string script = "#!/bin/sh\nexec";
  for (const std::string& word : command) script += " " + quoted(word);
  script += " \"$SLURM_ARRAY_TASK_ID\"\n";
  std::vector<std::string> submit{
      "sbatch", "--parsable", "--job-name=palpate-cohort", "--output=/dev/null",
      "--array=" + array_of(left) + (options.jobs > 0 ? "%" + std::to_string(options.jobs) : "")};
  submit.insert(submit.end(), options.sbatch.begin(), options.sbatch.end());
  const auto said = cohort::ask(submit, script);
  if (!said) return said.error();
  if (said->exit_code == 127) return without_slurm("sbatch");
  // "12", or "12;cluster"
  const std::string job = said->out.substr(0, said->out.find_first_of(";\n"));
  if (said->exit_code != 0 || job.empty() || job.find_first_not_of("0123456789") != job.npos)
    return Error{ErrorKind::kUnavailable, "Slurm refuses the job: " + first_line(said->err), "sbatch",
                 "--sbatch hands further options to sbatch, as --sbatch=--partition=NAME"};
  if (auto written = write_file(note, job + "\n"); !written) {
    (void)cohort::ask({"scancel", job}).ok();
    return written;
  }
  auto waited = wait_for(job, look, progress);
  // what was cancelled is not collected
  if (waited || waited.error().kind == ErrorKind::kInterrupted) fs::remove(note, none);
  return waited;
}

}  // namespace palpate
