#include "recorded_runs.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>

#include "palpate/base/hash.h"
#include "palpate/base/learner.h"
#include "palpate/base/printable.h"
#include "palpate/base/utc.h"
#include "palpate_version.h"

namespace palpate::app {
namespace {

Result<std::unique_ptr<Records>> opened_to_add(const std::filesystem::path& requested) {
  const auto file = records_file(requested);
  if (!file) return file.error();
  if (requested.empty() && file->has_parent_path()) {
    std::error_code reported_by_open;
    std::filesystem::create_directories(file->parent_path(), reported_by_open);
  }
  return Records::open(*file);
}

void warn_of_person(const std::string& learner, Console& console) {
  if (resembles_personal_name(learner))
    console.warn()("\"" + printable_name(learner) +
                   "\" looks like a person's name: records are for pseudonyms");
}

}  // namespace

Result<std::filesystem::path> records_file(const std::filesystem::path& requested) {
  const auto file = requested.empty() ? default_records_file() : requested;
  if (file.empty())
    return Error{ErrorKind::kUsage, "there is no folder for records: neither HOME nor XDG_DATA_HOME is set",
                 "", "give a file with --records"};
  return file;
}

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

// adds a run to the section of its task's text; the metrics of a text are listed in the order of its latest
// run
void LearnersPageBuilder::visit(const RunRecord& run) {
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

std::string LearnersPageBuilder::html() {
  LearnersPage page{PALPATE_VERSION " (commit " PALPATE_COMMIT ")", {}};
  for (auto& [key, task] : tasks_) {
    std::ranges::sort(task.learners, {}, &LearnersPage::Learner::name);
    page.tasks.push_back(std::move(task));
  }
  return learners_html(page);
}

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
  LearnersPageBuilder page;
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

}  // namespace palpate::app
