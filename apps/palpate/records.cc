#include "palpate/records/records.h"
#include "palpate/json/json.h"

#include <cstdio>
#include <functional>
#include <map>
#include <memory>

#include "apps/command/text.h"
#include "palpate/base/file.h"
#include "palpate/base/output.h"
#include "palpate/base/printable.h"
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

int write_page(const RecordsOptions& options, Console& console) {
  LearnersPageBuilder page;
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
