#include <cmath>

#include "report/html.h"
#include "report/page_sections.h"

namespace palpate::report {
namespace {

constexpr std::size_t kMaxShownEvents = 60;

std::string metric_row(const TaskMetric& metric, const MetricValue& value) {
  const std::string verdict = !value.counts ? "" : value.in_band ? "in band" : "<strong>out of band</strong>";
  const std::string basis = !value.counts          ? ""
                            : metric.basis.empty() ? "not validated"
                                                   : escape(metric.basis);
  return "<tr><th scope=\"row\">" + escape(readable_metric_name(metric_name(metric))) + "</th>" +
         cell(metric_text(value.metric, value.value)) + cell(bounds_text(metric)) + cell(verdict) + "<td>" +
         basis + "</td></tr>\n";
}

std::string step_list(const TaskFile& task, const TaskScore& score) {
  std::string html;
  for (std::size_t n = 0; n < task.steps.size(); ++n)
    html += "<li>" + escape(task.steps[n].name) + (score.done[n] ? ": done" : ": <strong>not done</strong>") +
            "</li>\n";
  return html.empty() ? "" : "<ol>\n" + html + "</ol>\n";
}

std::string event_list(const TaskFile& task, const TaskScore& score) {
  std::string html;
  const std::size_t shown = std::min(score.events.size(), kMaxShownEvents);
  for (std::size_t n = 0; n < shown; ++n) {
    const TaskEvent& event = score.events[n];
    html += "<li>" + number(event.time_s, 3) + " s, tick " + std::to_string(event.tick) + ": " +
            escape(event_text(task, event)) + "</li>\n";
  }
  const std::uint64_t left = score.events.size() - shown + score.more_events;
  if (left > 0) html += "<li>and " + std::to_string(left) + " more</li>\n";
  return html.empty() ? "" : "<details><summary>Events</summary><ul>\n" + html + "</ul></details>\n";
}

std::string verdict_text(const TaskScore& score) {
  if (score.in_band) return "Every counted metric is in its band.";
  if (score.cut_short) return "<strong>No pass:</strong> the recording was cut short.";
  if (score.missing_s > 0)
    return "<strong>No pass:</strong> " + number(score.missing_s, 3) +
           " s are missing because ticks were dropped.";
  return "<strong>Not every counted metric is in its band.</strong>";
}

}  // namespace

std::string task_html(const ScoredTask& scored) {
  const auto& [task, score] = scored;
  std::string html = "<section class=\"card\" aria-labelledby=\"task-title\"><h2 id=\"task-title\">Task: " +
                     escape(task.title) + "</h2>\n<p>" + escape(task.briefing) + "</p>\n<p>" +
                     verdict_text(score) + " " + number(score.time_s, 1) + " s. A pass takes " +
                     std::to_string(task.in_a_row) +
                     (task.in_a_row == 1 ? " such run" : " such runs in a row") + ".</p>\n";
  html +=
      "<div class=\"scroll\"><table><thead><tr><th scope=\"col\">Metric</th><th scope=\"col\">Value</th><th "
      "scope=\"col\">Band</th><th scope=\"col\"></th><th scope=\"col\">Basis</th></tr></thead><tbody>\n";
  for (const MetricValue& value : score.metrics) html += metric_row(task.metrics[value.part], value);
  return html + "</tbody></table></div>\n" + step_list(task, score) + event_list(task, score) +
         "</section>\n";
}

}  // namespace palpate::report
