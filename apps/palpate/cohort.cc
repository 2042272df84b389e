#include "palpate/cohort/cohort.h"

#include <string.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <map>
#include <memory>
#include <set>

#include "palpate/base/file.h"
#include "palpate/base/for_each_index.h"
#include "palpate/base/output.h"
#include "palpate/base/printable.h"
#include "palpate_version.h"
#include "palpation.h"
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
  // of the processes that this verb starts
  int number = 0;
  bool inside = false;
  std::vector<std::string> passed;  // options of the program that they get too
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

/// The command line that runs one case, but for its number.
Result<std::vector<std::string>> command_of(const CohortOptions& options) {
  std::error_code failed;
  const fs::path self = fs::read_symlink("/proc/self/exe", failed);
  if (failed)
    return Error{ErrorKind::kUnavailable, "the program does not find itself: " + failed.message(),
                 "/proc/self/exe", ""};
  std::vector<std::string> command{self.string(), "--quiet"};
  command.insert(command.end(), options.passed.begin(), options.passed.end());
  command.insert(command.end(), {"cohort", fs::absolute(options.table).string(), "-o",
                                 fs::absolute(options.folder).string()});
  if (options.script) command.insert(command.end(), {"--script", fs::absolute(*options.script).string()});
  if (options.recordings) command.push_back("--recordings");
  if (options.inside) command.push_back("--inside");
  command.push_back("--case");
  return command;
}

// ---- one case -------------------------------------------------------------------------------------------

/// Why a process that left no result has ended.
std::string fault_of(const EndedProcess& ended) {
  if (ended.signal > 0) {
    const char* name = ::sigabbrev_np(ended.signal);
    return "its process was ended by a signal, " +
           (name ? "SIG" + std::string(name) : std::to_string(ended.signal)) +
           (ended.signal == SIGKILL ? ": killed, or out of memory" : "");
  }
  // the first line of what it said last
  std::string said = ended.said;
  for (const std::string_view before : {"palpate: error: ", "palpate: bug: "})
    if (const auto at = said.rfind(before); at != said.npos) {
      said = said.substr(at + before.size());
      break;
    }
  said = said.substr(0, said.find('\n'));
  return printable(said.empty() ? "its process ended without a result" : said);
}

/// In a process of its own, which another one looks after: whatever becomes of it, there is a result.
int run_number(const CohortOptions& options, Console& console) {
  const auto cases = cases_of(options);
  if (!cases) return console.fail(cases.error());
  if (options.number > static_cast<int>(cases->size()))
    return console.fail({ErrorKind::kUsage, "there is no such case", "--case", ""});
  const CohortCase& one = (*cases)[static_cast<std::size_t>(options.number - 1)];
  const Progress progress = console.progress();
  if (options.inside) {
    const auto result =
        run_case(one, options.number, options.folder, {kProgram, options.recordings}, progress);
    return result ? kExitOk : console.fail(result.error());
  }
  std::error_code failed;
  const fs::path folder = case_folder(options.folder, options.number);
  fs::create_directories(folder, failed);
  // of a file that nobody writes: two runs do not work on one case
  const auto claimed = claim_output(folder / "case");
  if (!claimed) return console.fail(claimed.error());
  const fs::path result = folder / "result.json";
  fs::remove(result, failed);
  CohortOptions inside = options;
  inside.inside = true;
  auto command = command_of(inside);
  if (!command) return console.fail(command.error());
  command->push_back(std::to_string(options.number));
  const auto ended = run_process(*command, progress);
  if (!ended) return console.fail(ended.error());
  if (ended->exit_code == kExitOk || fs::exists(result, failed)) return kExitOk;
  const auto key = case_key(one, kProgram, progress);
  const auto written = write_fault(one, options.number, options.folder, key ? *key : "", fault_of(*ended));
  return written ? kExitOk : console.fail(written.error());
}

// ---- all of them ----------------------------------------------------------------------------------------

/// The cases' keys, each empty where a file of it cannot be read.
Result<std::vector<std::string>> keys_of(const std::vector<CohortCase>& cases, const Progress& progress) {
  std::vector<std::string> keys;
  for (std::size_t n = 0; n < cases.size(); ++n) {
    auto key = case_key(cases[n], kProgram, progress);
    if (!key && key.error().kind == ErrorKind::kInterrupted) return key.error();
    keys.push_back(key ? *std::move(key) : "");
    progress.report("looking at the cases' files",
                    static_cast<double>(n + 1) / static_cast<double>(cases.size()));
  }
  return keys;
}

Result<void> write_results(const CohortResults& cohort, const fs::path& folder) {
  for (const auto& [name, text] :
       {std::pair{"cohort.tsv", cohort_tsv(cohort)}, std::pair{"times.tsv", times_tsv(cohort, folder)},
        std::pair{"index.html", cohort_page(cohort, folder, kProgram)}})
    if (auto written = write_file(folder / name, text); !written) return written;
  return {};
}

int run_cohort(const CohortOptions& options, Console& console) {
  if (options.number > 0) return run_number(options, console);
  if (!options.sbatch.empty() && options.engine != "slurm")
    return console.fail({ErrorKind::kUsage, "is for Slurm", "--sbatch", "with --engine slurm"});
  CohortResults cohort;
  {
    auto cases = cases_of(options);
    if (!cases) return console.fail(cases.error());
    cohort.cases = *std::move(cases);
  }
  std::error_code failed;
  fs::create_directories(options.folder, failed);
  if (failed)
    return console.fail({ErrorKind::kOutput, "the folder cannot be made: " + failed.message(),
                         options.folder.string(), "name one where files can be written"});
  const auto claimed = claim_output(options.folder / "cohort.tsv");
  if (!claimed) return console.fail(claimed.error());

  const Progress progress = console.progress();
  const auto keys = keys_of(cohort.cases, progress);
  if (!keys) return console.fail(keys.error());
  const auto count = cohort.cases.size();
  cohort.results.resize(count);
  const auto collect = [&] {
    for (std::size_t n = 0; n < count; ++n)
      cohort.results[n] = find_case(options.folder, static_cast<int>(n) + 1, (*keys)[n]);
  };
  // done is what has a result without a fault, of the same inputs and program
  const auto left = [&] {
    collect();
    std::vector<int> numbers;
    for (std::size_t n = 0; n < count; ++n)
      if (!cohort.results[n] || !cohort.results[n]->fault.empty() || (*keys)[n].empty())
        numbers.push_back(static_cast<int>(n) + 1);
    return numbers;
  };
  const std::vector<int> numbers = left();
  if (numbers.size() < count)
    console.note(std::to_string(count - numbers.size()) + " of " + std::to_string(count) +
                 " cases are done already");
  // what is told of a fault is that of this run
  for (const int number : numbers) {
    fs::remove(case_folder(options.folder, number) / "result.json", failed);
    cohort.results[static_cast<std::size_t>(number - 1)].reset();
  }

  auto command = command_of(options);
  if (!command) return console.fail(command.error());
  std::set<int> told;
  const auto tell = [&](int number) {
    const auto n = static_cast<std::size_t>(number - 1);
    const auto result = find_case(options.folder, number, (*keys)[n]);
    if (!result || !told.insert(number).second) return;
    const std::string who = "case " + cohort.cases[n].name;
    console.note(who + (result->fault.empty() ? ": done" : " failed: " + printable_name(result->fault)));
    progress.report("cases", static_cast<double>(told.size()) / static_cast<double>(numbers.size()));
  };
  Result<void> ran;
  if (options.engine == "slurm") {
    SlurmOptions slurm{options.jobs, options.sbatch, fs::absolute(options.folder)};
    ran = run_by_slurm(
        *command, left, slurm,
        [&] {
          for (const int number : numbers)
            if (!told.contains(number)) tell(number);
        },
        progress);
  } else if (!numbers.empty()) {
    ran = run_locally(*command, numbers, options.jobs, tell, progress);
  }
  collect();
  const auto written = write_results(cohort, options.folder);
  if (!ran) {
    if (ran.error().kind == ErrorKind::kInterrupted)
      console.note("what is done stays: the same command goes on from there");
    return console.fail(ran.error());
  }
  if (!written) return console.fail(written.error());

  std::size_t done = 0;
  std::string others;
  for (std::size_t n = 0; n < count; ++n) {
    const auto& result = cohort.results[n];
    if (result && result->fault.empty()) {
      ++done;
      continue;
    }
    std::printf("case %s (line %d) %s\n", cohort.cases[n].name.c_str(), cohort.cases[n].line,
                result ? ("failed: " + printable_name(result->fault)).c_str()
                       : "has no result: its process was ended from outside");
  }
  std::printf("%zu of %zu cases done: %s\n", done, count, (options.folder / "index.html").string().c_str());
  return done == count ? kExitOk : kExitLimit;
}

}  // namespace

void add_cohort(CLI::App& app, Run& run) {
  auto options = std::make_shared<CohortOptions>();
  CLI::App* verb = app.add_subcommand("cohort", "Palpate many studies and compare them");
  verb->add_option("table", options->table, "Table of the cases: TSV or CSV with a line of column names")
      ->required();
  verb->add_option("-o,--output", options->folder, "Folder for tables, page and the cases' results")
      ->required();
  verb->add_option("-s,--script", options->script,
                   "Palpation script of the cases that name none; default: one that suits each");
  verb->add_option("--engine", options->engine,
                   "Where the cases are worked on: this machine's cores, or Slurm")
      ->check(CLI::IsMember({"local", "slurm"}))
      ->capture_default_str();
  verb->add_option("-j,--jobs", options->jobs,
                   "Cases at a time; default: one for each processor, or as many as Slurm gives")
      ->check(whole_between(1, 10'000));
  verb->add_option("--sbatch", options->sbatch,
                   "An option for sbatch, as --sbatch=--partition=long; may be given again");
  verb->add_flag("--recordings", options->recordings, "Keep each case's recording, run.h5");
  verb->add_option("--case", options->number)->check(whole_between(1, kMostCases))->group("");
  verb->add_flag("--inside", options->inside)->group("");
  verb->footer(
      "Examples:\n"
      "  palpate cohort cases.tsv -o results\n"
      "  palpate cohort cases.tsv -o results --script press.toml --jobs 4\n"
      "  palpate cohort cases.tsv -o results --engine slurm --sbatch=--mem=8G\n\n"
      "Columns: study, segmentation, script, case, volume, method, max_force, rate, seed. Writes cohort.tsv, "
      "a\n"
      "row a case; times.tsv; index.html, which sorts and compares; and below cases/ what each case is made "
      "of.\n"
      "A case that fails does not stop the others: it is named, and the exit code is 3. The same command "
      "again\n"
      "goes on where it was ended: a case that is done is not done anew unless its files, its row or the "
      "program\n"
      "have changed. docs/cohort.md.");
  verb->callback([&app, options, &run] {
    // they are options of the program that the cases' processes get as well
    for (const char* name : {"--memory", "--mesh-space", "--mesh-unit"})
      if (const CLI::Option* option = app.get_option(name); option->count() > 0)
        options->passed.insert(options->passed.end(), {name, option->results().front()});
    for (const char* name : {"--follow-links", "--no-cache"})
      if (app.get_option(name)->count() > 0) options->passed.emplace_back(name);
    run = [options](Console& console) { return run_cohort(*options, console); };
  });
}

}  // namespace palpate::app
