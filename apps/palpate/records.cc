#include "palpate/records/records.h"
#include "palpate/json/json.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <map>
#include <memory>

#include "apps/command/text.h"
#include "palpate/base/file.h"
#include "palpate/base/hash.h"
#include "palpate/base/learner.h"
#include "palpate/base/output.h"
#include "palpate/base/printable.h"
#include "palpate/base/utc.h"
#include "palpate/report/learners_page.h"
#include "palpate_version.h"
#include "recorded_runs.h"
#include "scoring.h"
#include "verb.h"

namespace palpate::app {
namespace {

struct RecordsOptions {
  std::filesystem::path file, output;
  RunFilter filter;
  std::int64_t id = 0;
  std::string format = "csv", home_page = "https://palpate.invalid/learners", learner;
  bool json = false, yes = false;
};

Result<std::filesystem::path> records_file(const std::filesystem::path& requested) {
  const auto file = requested.empty() ? default_records_file() : requested;
  if (file.empty())
    return Error{ErrorKind::kUsage, "there is no folder for records: neither HOME nor XDG_DATA_HOME is set",
                 "", "give a file with --records"};
  return file;
}

Result<std::unique_ptr<Records>> opened(const RecordsOptions& options) {
  const auto file = records_file(options.file);
  if (!file) return file.error();
  return Records::open_to_read(*file);
}

Json json_of(const RunRecord& run) {
  const auto number = [](const std::optional<double>& value) { return value ? Json(*value) : Json(nullptr); };
  Json json{{"run", run.id},
            {"learner", run.learner},
            {"task", run.task},
            {"task_hash", run.task_hash},
            {"started_utc", run.started_utc},
            {"data_set", run.data_set},
            {"palpate_version", run.palpate_version},
            {"commit", run.commit},
            {"device", run.device},
            {"hand", run.hand},
            {"settings_hash", run.settings_hash},
            {"run_hash", run.run_hash},
            {"score_hash", run.score_hash},
            {"duration_s", run.duration_s},
            {"in_a_row_asked", run.in_a_row},
            {"in_band", run.in_band}};
  if (run.metrics.empty()) return json;
  json["metrics"] = Json::array();
  for (const RunMetric& metric : run.metrics)
    json["metrics"].push_back({{"name", metric.name},
                               {"title", readable_metric_name(metric.name)},
                               {"value", number(metric.value)},
                               {"unit", metric.unit},
                               {"counts", metric.counts},
                               {"at_least", number(metric.at_least)},
                               {"at_most", number(metric.at_most)},
                               {"in_band", metric.in_band}});
  return json;
}

std::string text_of(const Json& json) {
  return json.dump();
}

int list(const RecordsOptions& options, Console& console) {
  auto records = opened(options);
  if (!records) return console.fail(records.error());
  // number of consecutive runs in band of each learner and task, within the listed runs
  std::map<std::pair<std::string, std::string>, int> in_a_row;
  if (!options.json)
    std::printf(
        "   run  started               learner           task                          in band  in a row\n");
  const auto done = (*records)->list(options.filter, [&](const RunRecord& run) -> Result<void> {
    if (options.json) {
      std::printf("%s\n", text_of(json_of(run)).c_str());
      return {};
    }
    int& row = in_a_row[{run.learner, run.task_hash}];
    row = run.in_band ? row + 1 : 0;
    std::printf("%6lld  %s  %s  %s  %s  %d of %d%s\n", static_cast<long long>(run.id),
                pad_or_truncate(printable_name(run.started_utc), 20).c_str(),
                pad_or_truncate(printable_name(run.learner), 16).c_str(),
                pad_or_truncate(printable_name(run.task), 28).c_str(), run.in_band ? "yes    " : "no     ",
                row, run.in_a_row, row >= run.in_a_row ? "  PASSED" : "");
    return {};
  });
  return done ? int{kExitOk} : console.fail(done.error());
}

int show(const RecordsOptions& options, Console& console) {
  auto records = opened(options);
  if (!records) return console.fail(records.error());
  const auto run = (*records)->run(options.id);
  if (!run) return console.fail(run.error());
  if (options.json) {
    std::printf("%s\n", text_of(json_of(*run)).c_str());
    return kExitOk;
  }
  const auto line = [](const char* name, const std::string& text) {
    std::printf("%-14s %s\n", name, printable_name(text).c_str());
  };
  line("run", std::to_string(run->id));
  line("learner", run->learner);
  line("task", run->task);
  line("started", run->started_utc);
  line("data set", run->data_set);
  line("palpate", run->palpate_version + " (" + run->commit + ")");
  line("device", run->device.empty() ? "a real one" : run->device);
  line("hand", run->hand.empty() ? "a real one" : run->hand);
  line("settings", run->settings_hash);
  line("score", run->score_hash);
  std::printf("%-14s %.2f s\n%-14s %s\n", "duration", run->duration_s, "in band",
              run->in_band ? "yes" : "no");
  for (const RunMetric& metric : run->metrics) {
    char value[40] = "none";
    if (metric.value) std::snprintf(value, sizeof value, "%.4g", *metric.value);
    std::printf("  %s  %s %s%s\n",
                pad_or_truncate(printable_name(readable_metric_name(metric.name)), 36).c_str(), value,
                metric.unit == "1" ? "" : printable_name(metric.unit).c_str(),
                !metric.counts   ? ""
                : metric.in_band ? "  in band"
                                 : "  OUT OF BAND");
  }
  return kExitOk;
}

/// Passes each selected run with its metrics to `visit`. @return number of runs
Result<std::size_t> each_run(Records& records, const RunFilter& filter,
                             const std::function<void(const RunRecord&)>& visit) {
  std::vector<std::int64_t> ids;
  const auto listed = records.list(filter, [&](const RunRecord& run) -> Result<void> {
    ids.push_back(run.id);
    return {};
  });
  if (!listed) return listed.error();
  for (const std::int64_t id : ids) {
    const auto run = records.run(id);
    if (!run) return run.error();
    visit(*run);
  }
  return ids.size();
}

/// Writes a file about all selected runs.
/// @param visit  called for each run
/// @param text  content of the file, called after the last run
int write_runs(const RecordsOptions& options, Console& console,
               const std::function<void(const RunRecord&)>& visit, const std::function<std::string()>& text) {
  const auto file = records_file(options.file);
  if (!file) return console.fail(file.error());
  auto records = Records::open_to_read(*file);
  if (!records) return console.fail(records.error());
  const std::vector<std::filesystem::path> never{*file, file->string() + "-wal", file->string() + "-shm"};
  const auto claimed = claim_output(options.output, never);
  if (!claimed) return console.fail(claimed.error());
  const auto count = each_run(**records, options.filter, visit);
  if (!count) return console.fail(count.error());
  if (const auto written = write_file(options.output, text()); !written) return console.fail(written.error());
  console.note(std::to_string(*count) + " runs: " + options.output.string());
  return kExitOk;
}

int export_runs(const RecordsOptions& options, Console& console) {
  const bool csv = options.format == "csv";
  std::string text = csv ? csv_heading() : "";
  return write_runs(
      options, console,
      [&](const RunRecord& run) {
        text += csv ? csv_rows(run) : xapi_statement(run, options.home_page, readable_metric_name) + "\n";
      },
      [&] { return text; });
}

/// Page about a set of runs.
class PageOfRuns {
 public:
  void visit(const RunRecord& run);
  std::string html();

 private:
  std::map<std::pair<std::string, std::string>, LearnersPage::Task> tasks_;  // by title and hash
};

// adds a run to the section of its task's text; the metrics of a text are listed in the order of its latest
// run
void PageOfRuns::visit(const RunRecord& run) {
  LearnersPage::Task& task = tasks_[{run.task, run.task_hash}];
  task.title = run.task;
  task.hash = run.task_hash;
  task.in_a_row = run.in_a_row;
  if (task.metrics.size() < run.metrics.size()) task.metrics.resize(run.metrics.size());
  LearnersPage::Run point{run.started_utc, run.duration_s, run.in_band, {}};
  for (std::size_t m = 0; m < run.metrics.size(); ++m) {
    const RunMetric& metric = run.metrics[m];
    task.metrics[m] = {readable_metric_name(metric.name), metric.unit, metric.at_least, metric.at_most,
                       metric.counts};
    point.values.push_back(metric.value.value_or(std::nan("")));
  }
  auto learner = std::ranges::find(task.learners, run.learner, &LearnersPage::Learner::name);
  if (learner == task.learners.end()) learner = task.learners.insert(learner, {run.learner, {}});
  learner->runs.push_back(std::move(point));
}

std::string PageOfRuns::html() {
  LearnersPage page{PALPATE_VERSION " (commit " PALPATE_COMMIT ")", {}};
  for (auto& [key, task] : tasks_) {
    std::ranges::sort(task.learners, {}, &LearnersPage::Learner::name);
    page.tasks.push_back(std::move(task));
  }
  return learners_html(page);
}

int write_page(const RecordsOptions& options, Console& console) {
  PageOfRuns page;
  return write_runs(
      options, console, [&](const RunRecord& run) { page.visit(run); }, [&] { return page.html(); });
}

int erase(const RecordsOptions& options, Console& console) {
  const auto file = records_file(options.file);
  if (!file) return console.fail(file.error());
  if (!options.yes)
    return console.fail({ErrorKind::kUsage,
                         "all runs of " + printable_name(options.learner) + " would be deleted permanently",
                         file->string(), "add --yes to confirm; palpate records export makes a copy"});
  // the file must exist: opening it for writing would create it
  if (auto there = Records::open_to_read(*file); !there) return console.fail(there.error());
  auto records = Records::open(*file);
  if (!records) return console.fail(records.error());
  const auto erased = (*records)->erase(options.learner);
  if (!erased) return console.fail(erased.error());
  if (!erased->was_known)
    return console.fail({ErrorKind::kBadInput, "there is no learner " + printable_name(options.learner),
                         file->string(), "palpate records list shows the learners"});
  std::printf("erased %lld runs of one learner; copies of the file are not erased\n",
              static_cast<long long>(erased->runs));
  return kExitOk;
}

}  // namespace

RunRecord record_of(const std::string& learner, const TaskFile& task, const ScoredRun& run) {
  const auto hexadecimal = [](std::uint64_t hash) {
    char text[17];
    std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(hash));
    return std::string(text);
  };
  // hash of the settings that determine the contact: the model, and the settings stored in the recording
  std::uint64_t settings = kHashSeed;
  hash_word(settings, run.header.model_hash);
  hash_bytes(settings, run.header.haptic_settings.data(), run.header.haptic_settings.size());
  RunRecord record{0,
                   learner,
                   task.title,
                   hexadecimal(task.text_hash),
                   utc_after(run.header.started_utc, run.score.started_s),
                   run.header.data_set,
                   run.header.palpate_version,
                   run.header.commit,
                   run.header.device,
                   run.header.hand,
                   hexadecimal(hash_finish(settings)),
                   hexadecimal(run.run_hash),
                   hexadecimal(run.score.hash),
                   run.score.time_s,
                   task.in_a_row,
                   run.score.in_band,
                   {}};
  for (const MetricValue& value : run.score.metrics) {
    const TaskMetric& metric = task.metrics[value.part];
    record.metrics.push_back({metric_name(metric), std::string(info_of(value.metric).unit),
                              std::isfinite(value.value) ? std::optional(value.value) : std::nullopt,
                              metric.at_least, metric.at_most, value.counts, value.counts && value.in_band});
  }
  return record;
}

static Result<std::unique_ptr<Records>> opened_to_add(const std::filesystem::path& requested) {
  const auto file = records_file(requested);
  if (!file) return file.error();
  if (requested.empty() && file->has_parent_path()) {
    std::error_code reported_by_open;
    std::filesystem::create_directories(file->parent_path(), reported_by_open);
  }
  return Records::open(*file);
}

static void warn_of_person(const std::string& learner, Console& console) {
  if (resembles_personal_name(learner))
    console.warn()("\"" + printable_name(learner) +
                   "\" looks like a person's name: records are for pseudonyms");
}

Result<std::int64_t> record_run(const std::filesystem::path& requested, const std::string& learner,
                                const TaskFile& task, const ScoredRun& scored, Console& console) {
  auto records = opened_to_add(requested);
  if (!records) return records.error();
  warn_of_person(learner, console);
  return (*records)->add(record_of(learner, task, scored));
}

Result<void> check_records(const std::filesystem::path& requested, const std::vector<std::string>& learners,
                           Console& console) {
  for (const std::string& learner : learners)
    if (auto named = check_learner(learner); !named) return named;
  if (auto records = opened_to_add(requested); !records) return records.error();
  for (const std::string& learner : learners) warn_of_person(learner, console);
  return {};
}

Result<std::string> learners_page_html(const std::filesystem::path& requested, const std::string& learner) {
  const auto file = records_file(requested);
  if (!file) return file.error();
  auto records = Records::open_to_read(*file);
  if (!records) return records.error();
  PageOfRuns page;
  RunFilter filter;
  filter.learner = learner;
  const auto count = each_run(**records, filter, [&](const RunRecord& run) { page.visit(run); });
  if (!count) return count.error();
  return page.html();
}

Result<RunHistory> add_run_with_history(const std::filesystem::path& requested, const std::string& learner,
                                        const TaskFile& task, const ScoredRun& scored) {
  // maximum number of earlier runs compared; older ones belong to another learning curve
  constexpr std::size_t kMaxRuns = 500;
  auto opened = opened_to_add(requested);
  if (!opened) return opened.error();
  Records& records = **opened;
  const RunRecord record = record_of(learner, task, scored);
  const auto id = records.add(record);
  if (!id) return id.error();
  RunHistory history;
  history.run_id = *id;
  history.best.assign(task.metrics.size(), kNoValue);
  std::vector<bool> in_band;
  std::vector<std::int64_t> earlier;
  const auto listed = records.list({learner, task.title, 0}, [&](const RunRecord& run) -> Result<void> {
    if (run.task_hash != record.task_hash || run.id > *id) return {};
    in_band.push_back(run.in_band);
    if (run.id < *id && run.in_band) earlier.push_back(run.id);
    return {};
  });
  // the run has been added, so a failure to list the others is no error
  if (!listed) return history;
  history.runs = static_cast<int>(in_band.size());
  history.in_a_row = runs_in_a_row(in_band);
  for (std::size_t n = earlier.size() - std::min(earlier.size(), kMaxRuns); n < earlier.size(); ++n) {
    const auto run = records.run(earlier[n]);
    if (!run) break;
    for (std::size_t m = 0; m < std::min(run->metrics.size(), history.best.size()); ++m) {
      const std::optional<double> value = run->metrics[m].value;
      if (!value) continue;
      double& best = history.best[m];
      const bool more = info_of(task.metrics[m].metric).more_is_better;
      if (std::isnan(best) || (more ? *value > best : *value < best)) best = *value;
    }
  }
  return history;
}

void add_records(CLI::App& app, Run& run) {
  auto options = std::make_shared<RecordsOptions>();
  CLI::App* verb = app.add_subcommand("records", "Training records: list, show, page, export, erase");
  verb->require_subcommand(1);
  verb->footer(
      "palpate task score RUN --task TASK --record LEARNER and palpate explore --task TASK --learner "
      "LEARNER\n"
      "write these records. A learner is a pseudonym; keep the identity elsewhere.\n"
      "The file is PALPATE_RECORDS, or palpate/records.db in XDG_DATA_HOME or ~/.local/share.");
  const auto add = [&](const char* name, const char* help, int (*what)(const RecordsOptions&, Console&)) {
    CLI::App* sub = verb->add_subcommand(name, help);
    sub->add_option("--records", options->file, "File of training records");
    sub->callback([options, &run, what] {
      run = [options, what](Console& console) { return what(*options, console); };
    });
    return sub;
  };
  const auto add_filter = [&](CLI::App* sub) {
    sub->add_option("--learner", options->filter.learner, "Only runs of this learner");
    sub->add_option("--task", options->filter.task, "Only runs of this task, by its title");
    sub->add_option("--newest", options->filter.newest, "Maximum number of runs to list, the newest")
        ->check(whole_between(1, 1000000000));
  };
  CLI::App* listing = add("list", "List the runs, one per line", list);
  add_filter(listing);
  listing->add_flag("--json", options->json, "Print one JSON object per line");
  CLI::App* showing = add("show", "Show a run with its metrics", show);
  showing->add_option("run", options->id, "Number of the run in the list")
      ->required()
      ->check(whole_between(1, 1ull << 62));
  showing->add_flag("--json", options->json, "Print JSON instead of text");
  CLI::App* drawing = add("page", "Write a page for teachers: learning curves, and who passed", write_page);
  add_filter(drawing);
  drawing->add_option("-o,--output", options->output, "HTML file to write")->required();
  CLI::App* exporting = add("export", "Export runs as CSV or as xAPI statements", export_runs);
  add_filter(exporting);
  exporting->add_option("--format", options->format, "csv: one line per metric; xapi: one statement per line")
      ->check(CLI::IsMember({"csv", "xapi"}));
  exporting->add_option("--home-page", options->home_page,
                        "Home page of xAPI actors: the system that assigns the pseudonyms");
  exporting->add_option("-o,--output", options->output, "File to write")->required();
  CLI::App* erasing = add("erase", "Securely erase a learner with all runs from the file", erase);
  erasing->add_option("learner", options->learner, "Pseudonym")->required();
  erasing->add_flag("--yes", options->yes, "Confirm");
}

}  // namespace palpate::app
