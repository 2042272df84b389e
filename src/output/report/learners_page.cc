#include "palpate/report/learners_page.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "report/html.h"
#include "report/page_head.h"

namespace palpate {

std::vector<double> median_curve(const std::vector<std::vector<double>>& curves) {
  std::vector<double> medians;
  for (std::size_t n = 0;; ++n) {
    std::size_t there = 0;
    std::vector<double> values;
    for (const std::vector<double>& curve : curves) {
      if (n >= curve.size()) continue;
      ++there;
      if (std::isfinite(curve[n])) values.push_back(curve[n]);
    }
    if (there < 2 || 2 * there < curves.size()) return medians;
    if (values.empty()) {
      medians.push_back(std::nan(""));
      continue;
    }
    std::ranges::sort(values);
    const std::size_t half = values.size() / 2;
    medians.push_back(values.size() % 2 == 1 ? values[half] : (values[half - 1] + values[half]) / 2);
  }
}

int runs_until_passed(const LearnersPage::Learner& learner, int in_a_row) {
  int row = 0;
  for (std::size_t n = 0; n < learner.runs.size(); ++n) {
    row = learner.runs[n].in_band ? row + 1 : 0;
    if (row >= in_a_row) return static_cast<int>(n) + 1;
  }
  return 0;
}

namespace report {
namespace {

// layout of a curve, in units of its SVG
constexpr double kWide = 320, kHigh = 150, kLeft = 46, kRight = 8, kTop = 8, kBottom = 20;
// maximum number of points drawn per curve
constexpr std::size_t kMaxOfCurve = 150;

std::string with_unit(double value, const std::string& unit) {
  return three_digits(value) + (unit == "1" || unit.empty() ? "" : " " + escape(unit));
}

std::string band_text(const LearnersPage::Metric& metric) {
  if (metric.at_least && metric.at_most)
    return with_unit(*metric.at_least, "1") + " to " + with_unit(*metric.at_most, metric.unit);
  if (metric.at_least) return "at least " + with_unit(*metric.at_least, metric.unit);
  if (metric.at_most) return "at most " + with_unit(*metric.at_most, metric.unit);
  return "no bound";
}

/// Scales of a curve's plot.
struct Axes {
  std::size_t runs = 1;
  double min = 0, max = 1;

  std::string x(std::size_t run) const {
    const double fraction = runs > 1 ? static_cast<double>(run) / static_cast<double>(runs - 1) : 0.5;
    return number(kLeft + fraction * (kWide - kLeft - kRight), 1);
  }
  double height(double value) const {
    const double fraction = std::clamp((value - min) / (max - min), 0.0, 1.0);
    return kTop + (1 - fraction) * (kHigh - kTop - kBottom);
  }
  std::string y(double value) const { return number(height(value), 1); }
};

Axes axes_of(const LearnersPage::Metric& metric, const std::vector<std::vector<double>>& curves) {
  Axes axes;
  double min_value = std::numeric_limits<double>::infinity(), max_value = -min_value;
  const auto include = [&](double value) {
    if (!std::isfinite(value)) return;
    min_value = std::min(min_value, value);
    max_value = std::max(max_value, value);
  };
  for (const std::vector<double>& curve : curves) {
    axes.runs = std::max(axes.runs, curve.size());
    for (const double value : curve) include(value);
  }
  if (metric.at_least) include(*metric.at_least);
  if (metric.at_most) include(*metric.at_most);
  if (!(min_value <= max_value)) return axes;
  const double room =
      max_value > min_value ? 0.06 * (max_value - min_value) : std::max(0.5 * std::abs(max_value), 0.5);
  // the axis of non-negative values does not extend below 0
  axes.min = min_value >= 0 ? std::max(0.0, min_value - room) : min_value - room;
  axes.max = max_value + room;
  return axes;
}

/// Polyline through the values, interrupted at missing ones.
std::string line_html(const Axes& axes, const std::vector<double>& curve, const std::string& kind) {
  const std::size_t stride = std::max<std::size_t>(1, (curve.size() + kMaxOfCurve - 1) / kMaxOfCurve);
  std::string path;
  bool is_down = false;
  std::size_t points = 0, last = 0;
  const auto put = [&](std::size_t n) {
    if (!std::isfinite(curve[n])) {
      is_down = false;
      return;
    }
    path += (is_down ? "L" : "M") + axes.x(n) + " " + axes.y(curve[n]);
    is_down = true;
    ++points;
    last = n;
  };
  for (std::size_t n = 0; n < curve.size(); n += stride) put(n);
  if (!curve.empty() && stride > 1 && (curve.size() - 1) % stride != 0) put(curve.size() - 1);
  if (points == 0) return "";
  if (points == 1)
    return "<circle class=\"lone\" r=\"2\" cx=\"" + axes.x(last) + "\" cy=\"" + axes.y(curve[last]) + "\"/>";
  return "<path class=\"" + kind + "\" d=\"" + path + "\"/>";
}

std::string curve_html(const LearnersPage::Task& task, std::size_t m) {
  const LearnersPage::Metric& metric = task.metrics[m];
  std::vector<std::vector<double>> curves;
  for (const LearnersPage::Learner& learner : task.learners) {
    std::vector<double>& curve = curves.emplace_back();
    for (const LearnersPage::Run& run : learner.runs)
      curve.push_back(m < run.values.size() ? run.values[m] : std::nan(""));
  }
  const Axes axes = axes_of(metric, curves);
  const std::vector<double> median = median_curve(curves);
  std::string svg = "<svg viewBox=\"0 0 320 150\" role=\"img\" aria-label=\"" + escape(metric.name) +
                    " over the number of the run: a line for each learner";
  if (!median.empty() && std::isfinite(median.back()))
    svg += "; median " + with_unit(median.front(), metric.unit) + " of first runs, " +
           with_unit(median.back(), metric.unit) + " of run " + std::to_string(median.size());
  svg += "\">";
  if (metric.at_least || metric.at_most) {
    const double top = metric.at_most ? axes.height(*metric.at_most) : kTop;
    const double bottom = metric.at_least ? axes.height(*metric.at_least) : kHigh - kBottom;
    svg += "<rect class=\"band\" x=\"" + number(kLeft, 0) + "\" width=\"" +
           number(kWide - kLeft - kRight, 0) + "\" y=\"" + number(top, 1) + "\" height=\"" +
           number(std::max(0.0, bottom - top), 1) + "\"/>";
    for (const std::optional<double>& bound : {metric.at_least, metric.at_most})
      if (bound)
        svg += "<path class=\"bound\" d=\"M" + number(kLeft, 0) + " " + axes.y(*bound) + "H" +
               number(kWide - kRight, 0) + "\"/>";
  }
  svg += "<path class=\"axis\" fill=\"none\" d=\"M" + number(kLeft, 0) + " " + number(kTop, 0) + "V" +
         number(kHigh - kBottom, 0) + "H" + number(kWide - kRight, 0) + "\"/>";
  for (const std::vector<double>& curve : curves) svg += line_html(axes, curve, "learner");
  svg += line_html(axes, median, "median");
  svg += "<text class=\"end\" x=\"" + number(kLeft - 4, 0) + "\" y=\"" + number(kTop + 8, 0) + "\">" +
         three_digits(axes.max) + "</text><text class=\"end\" x=\"" + number(kLeft - 4, 0) + "\" y=\"" +
         number(kHigh - kBottom, 0) + "\">" + three_digits(axes.min) + "</text><text x=\"" +
         number(kLeft, 0) + "\" y=\"" + number(kHigh - 6, 0) + "\">run 1</text><text class=\"end\" x=\"" +
         number(kWide - kRight, 0) + "\" y=\"" + number(kHigh - 6, 0) + "\">" +
         (axes.runs > 1 ? std::to_string(axes.runs) : "") + "</text></svg>";
  return "<div class=\"curve\"><h3>" + escape(metric.name) +
         (metric.unit == "1" || metric.unit.empty()
              ? ""
              : " <span class=\"unit\">" + escape(metric.unit) + "</span>") +
         "</h3><p class=\"hint\">" + band_text(metric) + (metric.counts ? "" : ", does not count") + "</p>" +
         svg + "</div>\n";
}

/// Dots for the latest runs, in band or not.
std::string dots_html(const LearnersPage::Learner& learner) {
  constexpr std::size_t kMaxDots = 14;
  const std::size_t from = learner.runs.size() - std::min(kMaxDots, learner.runs.size());
  std::string description, svg;
  for (std::size_t n = from; n < learner.runs.size(); ++n) {
    const bool in = learner.runs[n].in_band;
    svg += "<circle class=\"" + std::string(in ? "in" : "out") + "\" r=\"5\" cy=\"7\" cx=\"" +
           std::to_string(7 + 14 * (n - from)) + "\"/>";
    description += (description.empty() ? "" : ", ") + std::string(in ? "in band" : "out of band");
  }
  return "<svg class=\"dots\" viewBox=\"0 0 200 14\" role=\"img\" aria-label=\"latest runs: " + description +
         "\">" + svg + "</svg>";
}

std::string learner_row_html(const LearnersPage::Task& task, const LearnersPage::Learner& learner) {
  const auto in_band = std::ranges::count(learner.runs, true, &LearnersPage::Run::in_band);
  double practised_s = 0;
  for (const LearnersPage::Run& run : learner.runs) practised_s += run.duration_s;
  int row = 0;
  for (const LearnersPage::Run& run : learner.runs) row = run.in_band ? row + 1 : 0;
  const int passed = runs_until_passed(learner, task.in_a_row);
  std::string html = "<tr><th scope=\"row\">" + escape(learner.name) + "</th>" +
                     cell(std::to_string(learner.runs.size())) + cell(std::to_string(in_band)) +
                     cell(std::to_string(row)) +
                     cell(passed > 0 ? "<span class=\"passed\">passed</span>, run " + std::to_string(passed)
                                     : std::string("not yet")) +
                     cell(number(practised_s / 60, 1)) + cell(escape(learner.runs.back().started_utc)) +
                     cell(dots_html(learner));
  for (std::size_t m = 0; m < task.metrics.size(); ++m) {
    if (!task.metrics[m].counts) continue;
    const std::vector<double>& values = learner.runs.back().values;
    html += cell(three_digits(m < values.size() ? values[m] : std::nan("")));
  }
  return html + "</tr>\n";
}

std::string learned_task_html(const LearnersPage::Task& task, std::size_t number_of_task) {
  const std::string id = "task-" + std::to_string(number_of_task);
  std::string html = "<section class=\"card task\" aria-labelledby=\"" + id + "\"><h2 id=\"" + id + "\">" +
                     escape(task.title) + "</h2><p class=\"hint\">Passed by " +
                     std::to_string(task.in_a_row) + (task.in_a_row == 1 ? " run" : " runs in a row") +
                     " with every counted metric in its band. Text of the task: <code>" + escape(task.hash) +
                     "</code></p>\n<div class=\"curves\">\n";
  for (const bool counts : {true, false})
    for (std::size_t m = 0; m < task.metrics.size(); ++m)
      if (task.metrics[m].counts == counts) html += curve_html(task, m);
  html +=
      "</div>\n"
      "<p class=\"hint\">Grey: each learner, run by run. Thick: the median, up to the run that half of them "
      "reached. Shaded: the band of the latest run.</p>\n"
      "<div class=\"scroll\" tabindex=\"0\" role=\"group\" aria-labelledby=\"" +
      id +
      "\"><table><thead><tr><th scope=\"col\">learner</th><th scope=\"col\">runs</th><th scope=\"col\">in "
      "band</th><th scope=\"col\">current streak</th><th scope=\"col\">passed</th><th "
      "scope=\"col\">practised <span class=\"unit\">min</span></th><th scope=\"col\">latest</th><th "
      "scope=\"col\">latest runs</th>";
  for (const LearnersPage::Metric& metric : task.metrics)
    if (metric.counts)
      html += "<th scope=\"col\">" + escape(metric.name) + " <span class=\"unit\">" +
              (metric.unit == "1" ? "" : escape(metric.unit) + ", ") + "latest</span></th>";
  html += "</tr></thead><tbody>\n";
  for (const LearnersPage::Learner& learner : task.learners) html += learner_row_html(task, learner);
  return html + "</tbody></table></div></section>\n";
}

std::string learners_tile(const std::string& term, std::size_t count) {
  return "<div class=\"tile\"><dt>" + term + "</dt><dd>" + grouped(count) + "</dd></div>\n";
}

}  // namespace
}  // namespace report

std::string learners_html(const LearnersPage& page) {
  using namespace report;
  std::vector<std::string> learners;
  std::size_t runs = 0;
  for (const LearnersPage::Task& task : page.tasks)
    for (const LearnersPage::Learner& learner : task.learners) {
      learners.push_back(learner.name);
      runs += learner.runs.size();
    }
  std::ranges::sort(learners);
  learners.erase(std::unique(learners.begin(), learners.end()), learners.end());
  std::string html = page_head_html("Learners", {"page.css", "learners.css"}, {}) +
                     "<body>\n"
                     "<div class=\"banner\" role=\"note\"><strong>Research and education - not for clinical "
                     "use</strong></div>\n"
                     "<main>\n"
                     "<header><p class=\"kicker\">palpate records page</p><h1>Learning curves</h1></header>\n"
                     "<dl class=\"tiles\">\n" +
                     learners_tile("learners", learners.size()) + learners_tile("runs", runs) +
                     learners_tile("tasks", page.tasks.size()) + "</dl>\n";
  if (page.tasks.empty()) html += "<p class=\"empty\">There is no such run.</p>\n";
  for (std::size_t n = 0; n < page.tasks.size(); ++n) html += learned_task_html(page.tasks[n], n);
  return html + "<p class=\"hint\">palpate " + escape(page.program) +
         ". The value of a band depends on its basis: see palpate task show and docs/guide/tasks.md. "
         "Learners are pseudonyms.</p>\n"
         "</main>\n"
         "</body>\n"
         "</html>\n";
}

}  // namespace palpate
