#include "palpate/cohort/case.h"
#include "palpate/cohort/cohort_summary.h"
#include "palpate/cohort/cohort_table.h"
#include "palpate/cohort/engines.h"

#include <signal.h>
#include <string.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <map>
#include <memory>
#include <set>

#include "apps/command/program.h"
#include "palpate/base/file.h"
#include "palpate/base/for_each_index.h"
#include "palpate/base/output.h"
#include "palpate/base/printable.h"
#include "palpate/catalog/catalog.h"
#include "palpate_version.h"
#include "scene_options.h"
#include "verb.h"

namespace palpate::app {
namespace {

namespace fs = std::filesystem;

struct CohortOptions {
  fs::path table, folder;
  std::optional<fs::path> script;
  std::string engine = "local";
  int jobs = 0;
  std::vector<std::string> sbatch;
  bool recordings = false;
  // for the processes that this verb starts
  int number = 0;
  bool in_this_process = false;  // run the case in this process instead of a child process
  std::vector<std::string> passed,
      passed_to_verb;      // options of the program and of the verb that are passed on
  std::string results_by;  // passed options that change results
};

constexpr const char* kProgram = PALPATE_VERSION " (commit " PALPATE_COMMIT ", " PALPATE_BUILD_TYPE ")";

Result<std::vector<CohortCase>> cases_of(const CohortOptions& options) {
  auto cases = load_cohort_table(options.table);
  if (!cases) return cases;
  if (options.script)
    for (CohortCase& one : *cases)
      if (!one.script) one.script = options.script;
  return cases;
}

/// Program version and options that enter the key of a case.
std::string program_key(const CohortOptions& options) {
  return kProgram + options.results_by;
}

/// Whether a valid result exists, so that the case need not run again.
bool is_done(const CohortOptions& options, int number, const std::string& key) {
  if (key.empty()) return false;
  const auto result = find_case(options.folder, number, key);
  std::error_code failed;
  return result && result->fault.empty() &&
         (!options.recordings || fs::is_regular_file(case_folder(options.folder, number) / "run.h5", failed));
}

/// Command line that runs one case, without the number of the case.
Result<std::vector<std::string>> command_of(const CohortOptions& options) {
  std::error_code failed;
  const fs::path self = fs::read_symlink("/proc/self/exe", failed);
  if (failed)
    return Error{ErrorKind::kUnavailable,
                 "the path of this program cannot be determined: " + failed.message(), "/proc/self/exe", ""};
  std::vector<std::string> command{self.string(), "--quiet"};
  command.insert(command.end(), options.passed.begin(), options.passed.end());
  command.insert(command.end(), {"cohort", fs::absolute(options.table).string(), "-o",
                                 fs::absolute(options.folder).string()});
  if (options.script) command.insert(command.end(), {"--script", fs::absolute(*options.script).string()});
  command.insert(command.end(), options.passed_to_verb.begin(), options.passed_to_verb.end());
  if (options.recordings) command.push_back("--recordings");
  if (options.in_this_process) command.push_back("--inside");
  command.push_back("--case");
  return command;
}

// ---- one case -------------------------------------------------------------------------------------------

/// Reason why a process ended without a result, as text without the names of the case's files.
std::string fault_of(const EndedProcess& ended, const CohortCase& one, const CohortOptions& options) {
  if (ended.signal > 0) {
    const char* name = ::sigabbrev_np(ended.signal);
    return "its process was ended by a signal, " +
           (name ? "SIG" + std::string(name) : std::to_string(ended.signal)) +
           (ended.signal == SIGKILL ? ": killed, or out of memory" : "");
  }
  // first line of its last error message
  std::string error_output = ended.error_output;
  for (const std::string_view before : {"palpate: error: ", "palpate: bug: "})
    if (const auto at = error_output.rfind(before); at != error_output.npos) {
      error_output = error_output.substr(at + before.size());
      break;
    }
  error_output = printable(error_output.substr(0, error_output.find('\n')));
  if (ended.exit_code == kExitOk) return "its process left no result";
  const std::string code = "its process ended with exit code " + std::to_string(ended.exit_code);
  return error_output.empty() ? code : code + ": " + without_names(error_output, one, options.folder);
}

/// Runs one case in a child process, so that a result is written even if that process crashes.
int run_single_case(const CohortOptions& options, Console& console) {
  const auto cases = cases_of(options);
  if (!cases) return console.fail(cases.error());
  if (options.number > static_cast<int>(cases->size()))
    return console.fail({ErrorKind::kUsage, "no such case", "--case", ""});
  const CohortCase& one = (*cases)[static_cast<std::size_t>(options.number - 1)];
  const Progress progress = console.progress();
  if (options.in_this_process) {
    const auto result =
        run_case(one, options.number, options.folder, {program_key(options), options.recordings}, progress);
    return result ? kExitOk : console.fail(result.error());
  }
  std::error_code failed;
  const fs::path folder = case_folder(options.folder, options.number);
  fs::create_directories(folder, failed);
  // lock for the case, on a file that is never written: two runs must not process one case
  const auto claimed = claim_output(folder / "case");
  if (!claimed) return console.fail(claimed.error());
  const fs::path result = folder / "result.json";
  const auto key = case_key(one, program_key(options), progress);
  if (!key && key.error().kind == ErrorKind::kInterrupted) return console.fail(key.error());
  // another job has finished the case in the meantime
  if (key && is_done(options, options.number, *key)) return kExitOk;
  fs::remove(result, failed);
  CohortOptions child_options = options;
  child_options.in_this_process = true;
  auto command = command_of(child_options);
  if (!command) return console.fail(command.error());
  command->push_back(std::to_string(options.number));
  const auto ended = run_process(*command, progress);
  if (!ended) return console.fail(ended.error());
  if (ended->exit_code == kExitOk || fs::exists(result, failed)) return kExitOk;
  const auto written =
      write_fault(one, options.number, options.folder, key ? *key : "", fault_of(*ended, one, options));
  return written ? kExitOk : console.fail(written.error());
}

// ---- all of them ----------------------------------------------------------------------------------------

/// Keys of the cases; empty for a case with a file that cannot be read.
Result<std::vector<std::string>> keys_of(const std::vector<CohortCase>& cases, const CohortOptions& options,
                                         const Progress& progress) {
  std::vector<std::string> keys;
  for (std::size_t n = 0; n < cases.size(); ++n) {
    auto key = case_key(cases[n], program_key(options), progress);
    if (!key && key.error().kind == ErrorKind::kInterrupted) return key.error();
    keys.push_back(key ? *std::move(key) : "");
    progress.report("examining the cases' files",
                    static_cast<double>(n + 1) / static_cast<double>(cases.size()));
  }
  return keys;
}

constexpr std::array kOutputs{"cohort.tsv", "times.tsv", "index.html"};

Result<void> write_results(const CohortResults& cohort, const fs::path& folder) {
  const std::array texts{cohort_tsv(cohort), times_tsv(cohort, folder),
                         cohort_page(cohort, folder, kProgram)};
  for (std::size_t n = 0; n < kOutputs.size(); ++n)
    if (auto written = write_file(folder / kOutputs[n], texts[n]); !written) return written;
  return {};
}

bool is_within(const fs::path& what, const fs::path& folder) {
  std::error_code failed;
  const fs::path inner = fs::weakly_canonical(fs::absolute(what, failed), failed);
  const fs::path outer = fs::weakly_canonical(fs::absolute(folder, failed), failed);
  if (inner.empty() || outer.empty()) return false;
  return std::ranges::mismatch(outer, inner).in1 == outer.end();
}

/// Checks that the folder of the results contains none of the data: the results would change what the next
/// run reads, or replace it.
Result<void> check_folder(const CohortOptions& options, const std::vector<CohortCase>& cases,
                          std::vector<fs::path>& inputs) {
  const auto refuse = [&](const CohortCase& one, const std::string& why) {
    return Error{ErrorKind::kUsage, why + " (case " + one.name + ", line " + std::to_string(one.line) + ")",
                 options.folder.string(), "choose a separate folder for the results (-o)"};
  };
  std::error_code failed;
  std::set<fs::path> folders;
  for (const CohortCase& one : cases) {
    std::vector<fs::path> named;
    if (!find_entry(one.target).ok()) named.emplace_back(one.target);
    if (one.segmentation) named.push_back(*one.segmentation);
    constexpr const char* kBeside = "holds data; tables next to labels are read as their names";
    for (const fs::path& study : named) {
      if (!fs::is_directory(study, failed)) continue;
      if (is_within(options.folder, study)) return refuse(one, "is inside a folder that is read as a study");
      if (same_file(fs::absolute(study, failed).lexically_normal().parent_path(), options.folder))
        return refuse(one, kBeside);
    }
    for (const auto& [role, file] : case_files(one)) {
      if (file.empty()) continue;
      inputs.push_back(file);
      if (!folders.insert(file.parent_path()).second) continue;
      if (is_within(file, options.folder / "cases"))
        return refuse(one, "has data in its folder 'cases', where the results go");
      if (role != "script" &&
          same_file(file.parent_path().empty() ? fs::path(".") : file.parent_path(), options.folder))
        return refuse(one, kBeside);
    }
  }
  return {};
}

/// One run of the verb over all cases: open(), run(), report().
class CohortRun {
 public:
  CohortRun(const CohortOptions& options, Console& console)
      : options_(options), console_(console), progress_(console.progress()) {}

  /// Reads the table, claims the outputs, and removes the faults of earlier runs.
  Result<void> open() {
    auto cases = cases_of(options_);
    if (!cases) return cases.error();
    cohort_.cases = *std::move(cases);
    if (auto claimed = claim_outputs(); !claimed) return claimed;
    if (options_.engine == "local")
      if (auto none = check_no_slurm_job(options_.folder); !none) return none;
    auto keys = keys_of(cohort_.cases, options_, progress_);
    if (!keys) return keys.error();
    keys_ = *std::move(keys);
    cohort_.results.resize(keys_.size());

    numbers_ = collect_unfinished();
    const std::size_t count = keys_.size();
    if (numbers_.size() < count)
      console_.note(std::to_string(count - numbers_.size()) + " of " + std::to_string(count) +
                    " cases are already done");
    // faults of earlier runs are removed, so that only those of this run are reported
    std::error_code failed;
    for (const int number : numbers_) {
      fs::remove(case_folder(options_.folder, number) / "result.json", failed);
      cohort_.results[index_of(number)].reset();
    }
    return {};
  }

  /// Runs the unfinished cases and writes the results. Errors: of the engine, otherwise of writing.
  Result<void> run() {
    auto command = command_of(options_);
    if (!command) return command.error();
    const Result<void> ran = options_.engine == "slurm" ? run_on_slurm(*command) : run_here(*command);
    collect();
    for (const auto& [number, reason] : reasons_)
      if (auto& result = cohort_.results[index_of(number)]; !result) {
        result.emplace();
        result->fault = reason;
      }
    const auto written = write_results(cohort_, options_.folder);
    if (!ran) {
      if (ran.error().kind == ErrorKind::kInterrupted)
        console_.note("completed cases are kept: run the same command again to resume");
      return ran;
    }
    return written;
  }

  /// Prints the cases without a result; returns the exit code.
  int report() const {
    std::size_t done = 0;
    for (std::size_t n = 0; n < keys_.size(); ++n) {
      const auto& result = cohort_.results[n];
      if (result && result->fault.empty()) {
        ++done;
        continue;
      }
      std::printf("case %s (line %d) %s\n", cohort_.cases[n].name.c_str(), cohort_.cases[n].line,
                  result ? ("failed: " + printable_name(result->fault)).c_str()
                  : options_.engine == "slurm"
                      ? "has no result: Slurm ended its task, or its output is not visible on this machine"
                      : "has no result yet");
    }
    std::printf("%zu of %zu cases done: %s\n", done, keys_.size(),
                (options_.folder / "index.html").string().c_str());
    return done == keys_.size() ? kExitOk : kExitLimit;
  }

 private:
  static std::size_t index_of(int number) { return static_cast<std::size_t>(number - 1); }

  Result<void> claim_outputs() {
    std::vector<fs::path> inputs{options_.table};
    if (options_.script) inputs.push_back(*options_.script);
    if (auto checked = check_folder(options_, cohort_.cases, inputs); !checked) return checked;
    std::error_code failed;
    fs::create_directories(options_.folder, failed);
    if (failed)
      return Error{ErrorKind::kOutput, "the folder cannot be made: " + failed.message(),
                   options_.folder.string(), "choose one that you may write to"};
    for (const char* name : kOutputs) {
      auto claimed = claim_output(options_.folder / name, inputs);
      if (!claimed) return claimed.error();
      claims_.push_back(*std::move(claimed));
    }
    return {};
  }

  /// Reads the results of all cases.
  void collect() {
    for (std::size_t n = 0; n < keys_.size(); ++n)
      cohort_.results[n] = find_case(options_.folder, static_cast<int>(n) + 1, keys_[n]);
  }
  /// Reads the results of all cases; returns the numbers of those without a fault-free result of the same
  /// inputs and program.
  std::vector<int> collect_unfinished() {
    collect();
    std::vector<int> numbers;
    for (int number = 1; number <= static_cast<int>(keys_.size()); ++number)
      if (!is_done(options_, number, keys_[index_of(number)])) numbers.push_back(number);
    return numbers;
  }

  /// Reports a case once it has a result.
  void report_case(int number) {
    const std::size_t n = index_of(number);
    const auto result = find_case(options_.folder, number, keys_[n]);
    if (!result || !reported_.insert(number).second) return;
    const std::string who = "case " + cohort_.cases[n].name;
    console_.note(who + (result->fault.empty() ? ": done" : " failed: " + printable_name(result->fault)));
    progress_.report("cases", static_cast<double>(reported_.size()) / static_cast<double>(numbers_.size()));
  }

  Result<void> run_on_slurm(const std::vector<std::string>& command) {
    const SlurmOptions slurm{options_.jobs, options_.sbatch, fs::absolute(options_.folder)};
    return run_by_slurm(
        command, [&] { return collect_unfinished(); }, slurm,
        [&] {
          for (const int number : numbers_)
            if (!reported_.contains(number)) report_case(number);
          return numbers_.size() - reported_.size();
        },
        progress_);
  }
  Result<void> run_here(const std::vector<std::string>& command) {
    if (numbers_.empty()) return {};
    return run_locally(
        command, numbers_, options_.jobs,
        [&](int number, const EndedProcess& how) {
          report_case(number);
          if (reported_.contains(number)) return;
          reasons_[number] = fault_of(how, cohort_.cases[index_of(number)], options_);
        },
        progress_);
  }

  const CohortOptions& options_;
  Console& console_;
  const Progress progress_;
  CohortResults cohort_;
  std::vector<OutputClaim> claims_;
  std::vector<std::string> keys_;  ///< Result key of each case
  std::vector<int> numbers_;       ///< Unfinished cases at the start
  std::set<int> reported_;
  /// Faults of processes that could not leave a result, by case: the disk is full, or another run has locked
  /// the case
  std::map<int, std::string> reasons_;
};

int run_cohort(const CohortOptions& options, Console& console) {
  if (options.number > 0) return run_single_case(options, console);
  if (!options.sbatch.empty() && options.engine != "slurm")
    return console.fail({ErrorKind::kUsage, "is for Slurm", "--sbatch", "with --engine slurm"});
  CohortRun run(options, console);
  if (auto opened = run.open(); !opened) return console.fail(opened.error());
  if (auto ran = run.run(); !ran) return console.fail(ran.error());
  return run.report();
}

}  // namespace

void add_cohort(CLI::App& app, Run& run) {
  auto options = std::make_shared<CohortOptions>();
  CLI::App* verb = app.add_subcommand("cohort", "Palpate many studies and compare them");
  verb->add_option("table", options->table, "Table of cases: TSV or CSV with a header line")->required();
  verb->add_option("-o,--output", options->folder,
                   "Folder for the tables, the page and the results of each case")
      ->required();
  verb->add_option("-s,--script", options->script,
                   "Palpation script for cases that do not name one; default: one planned for each case");
  verb->add_option("--engine", options->engine, "Where the cases run: on this machine's cores, or on Slurm")
      ->check(CLI::IsMember({"local", "slurm"}))
      ->capture_default_str();
  verb->add_option("-j,--jobs", options->jobs,
                   "Cases run in parallel; default: one per processor, or as many as Slurm grants")
      ->check(whole_between(1, 10'000));
  verb->add_option("--sbatch", options->sbatch,
                   "Option passed to sbatch, such as --sbatch=--partition=long; may be repeated");
  verb->add_flag("--recordings", options->recordings, "Keep the recording of each case, run.h5");
  add_content_options(*verb);
  verb->add_option("--case", options->number)->check(whole_between(1, kMaxCases))->group("");
  verb->add_flag("--inside", options->in_this_process)->group("");
  verb->footer(
      "Examples:\n"
      "  palpate cohort cases.tsv -o results\n"
      "  palpate cohort cases.tsv -o results --script press.toml --jobs 4\n"
      "  palpate cohort cases.tsv -o results --engine slurm --sbatch=--mem=8G\n\n"
      "Columns: study, segmentation, names, script, case, volume, method, max_force, rate, seed. Writes\n"
      "cohort.tsv, one row per case; times.tsv; index.html, to sort and compare the cases; and cases/ with "
      "the\n"
      "results of each case. A case that fails does not stop the others: it is reported, and the exit code "
      "is 3.\n"
      "Run the same command again to resume: a completed case is skipped unless its files, its row or the\n"
      "program have changed. docs/guide/cohort.md.");
  verb->callback([&app, verb, options, &run] {
    const auto pass_on = [&](const CLI::Option& option, const char* name, bool has_value,
                             bool changes_results, std::vector<std::string>& passed) {
      if (option.count() == 0) return;
      passed.emplace_back(name);
      if (has_value) passed.push_back(option.results().front());
      if (changes_results) options->results_by += std::string(" ") + name + " " + option.results().front();
    };
    for (const GlobalOption& global : kGlobalOptions)
      if (global.is_passed_on)
        pass_on(*app.get_option(global.name), global.name, global.has_value, global.changes_results,
                options->passed);
    for (const char* name : {"--labels", "--scan"})
      pass_on(*verb->get_option(name), name, false, true, options->passed_to_verb);
    run = [options](Console& console) { return run_cohort(*options, console); };
  });
}

}  // namespace palpate::app
